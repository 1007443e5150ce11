"""Self-contained checkpoints of plain containers, read without running code in them.

Besides its weights a checkpoint holds a typed card under the key `drivezoo`. The card names the
user's parts by module and hash, but does not choose the code that runs: the user names the part,
see `zoo.base.parts`.
"""

import io
import multiprocessing
import pickle
import sys
import warnings
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import torch
from torch import Tensor, nn

from datamodules.view import View
from zoo.base.bounded_files import hash_file, open_binary
from zoo.base.errors import InputError, file_errors
from zoo.base.limits import check_unpacked, open_archive
from zoo.base.parts import Part, part_class, part_of, unknown_part
from zoo.base.plain_files import check_text, check_version, leaves
from zoo.base.rig import UDACITY, Rig
from zoo.base.rig_file import find_rig
from zoo.base.terminal import error_line
from zoo.checkpoints.checkpoint_path import FOLDER, STARTED_IN
from zoo.checkpoints.checkpoint_path import find_checkpoint as find_checkpoint
from zoo.checkpoints.network_files import (
    MOST_BYTES,
    SCRIPT,
    describe_network,
    describe_script,
    describe_torch,
    torch_kind,
)
from zoo.checkpoints.pickle_limits import MOST_BYTES as MOST_PICKLE_BYTES
from zoo.checkpoints.pickle_limits import check_pickles
from zoo.checkpoints.policy_kinds import kind_names, policy_kind
from zoo.models.make_network import make_network
from zoo.runs.allowed_classes import with_present_names
from zoo.runs.record_fields import Count, Fields, Number, Whole, check_fields

FORMAT = 1
SPARE_PARAMETERS = 1_000_000  # more than those in the file; else their shapes are compared
FLOATS = (torch.float32, torch.float16, torch.bfloat16, torch.float64)
PREFIX = "network."  # the network's name in the LightningModule's state


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint's contents, for driving and for further training.

    Attributes:
        network: network with its weights, in evaluation mode, on the CPU.
        view: the network's input.
        config: the experiment's whole config, in plain containers.
        data: the recording's `fingerprint`, number of `rows`, `rows_per_s`, and median `speed_mph`.
    """

    network: nn.Module
    view: View
    config: dict
    data: dict


class ConfigFields(Fields):
    """The experiment's config."""

    model: dict[str, object]
    data: dict[str, object] | None = None


class ViewFields(Fields):
    """The network's view; `datamodules.view.View` checks the values."""

    crop: list[Whole]
    colour: str
    size: list[Whole] | None
    resize: str
    frame: list[Whole] | None = None


class DataFields(Fields):
    """The recording's rows."""

    fingerprint: str | None = None
    rows: Whole | None = None
    rows_per_s: Number | None = None
    speed_mph: Number | None = None
    split_by: str | None = None
    curvature_per_m: Number | None = None  # see `zoo.base.rig.SteeringLabel`
    source: str | None = None  # its other car or format; None for Udacity's rig
    rig: str | None = None  # name of another car's rig; None if it is unknown
    row_hashes: list[Count] | None = None  # see `datamodules.recording.Recording.row_hashes`
    roads: list[str] | None = None  # see `zoo.training.recorded_roads`


class PartCard(Fields):
    """A part of the user's that the config names, see `part_cards`."""

    module: str
    name: str
    sha256: str


class Card(Fields):
    """A card, as `make_card` returns it."""

    config: ConfigFields
    view: ViewFields
    data: DataFields
    parts: list[PartCard] | None = None  # only where there are some
    precision: str | None = None  # of the training: the config may say `auto`
    started_in: str | None = None  # of the training; files for other people lack it


def make_card(config: dict, view: View, data: dict) -> dict:
    """Return what every checkpoint holds under the key `drivezoo`, besides the weights."""
    card = {"format": FORMAT, "config": config, "view": view.to_dict(), "data": data}
    parts = part_cards(config)
    return {**card, "parts": parts} if parts else card


def read_checkpoint_file(path: str | Path) -> dict:
    """Return a checkpoint file's contents as plain containers.

    Raises:
        InputError: the file does not exist, is not a checkpoint of drivezoo or holds several of
            them, or contains code.
    """
    path = Path(path)
    return checked_contents(load_plain(path), path)


def trained_epochs(contents: dict) -> int:
    """Return the number of the epoch after which a checkpoint was saved; 0 for initial weights."""
    return int(contents["epoch"]) + (contents.get("global_step") != 0)


def is_checkpoint(contents: Any) -> bool:
    """Return whether a file's contents have a card and weights, as a checkpoint of drivezoo."""
    return has_card(contents) and "state_dict" in contents


def has_card(contents: Any) -> bool:
    """Return whether drivezoo wrote a file's contents."""
    return isinstance(contents, dict) and isinstance(contents.get("drivezoo"), dict)


def checked_contents(contents: Any, path: Path) -> dict:
    """Return a file's contents, checked to be a checkpoint; see `read_checkpoint_file`."""
    if not is_checkpoint(contents):
        raise InputError(f"{path}: {_describe_contents(contents, path)}")
    card = contents["drivezoo"]
    check_version(card.get("format"), FORMAT, path)
    renamed = {"config": with_present_names(card["config"])} if "config" in card else {}
    return {**contents, "drivezoo": card | renamed}


def _describe_contents(contents: Any, path: Path) -> str:
    """Return what a torch file is that is not a checkpoint of drivezoo."""
    if kind := policy_kind(contents):
        return f"is a {kind.title}, which only drives; name a checkpoint that it was written from"
    states = {"": contents} | (contents if isinstance(contents, dict) else {})
    for key, state in states.items():
        if isinstance(state, dict) and state and all(map(torch.is_tensor, state.values())):
            load = f"torch.load({str(path)!r}, weights_only=True){f'[{key!r}]' if key else ''}"
            code = "from YOUR_FILE import YOUR_CLASS; net = YOUR_CLASS()"
            return describe_torch(f"{code}; net.load_state_dict({load})")
    kinds = f", or of an installed kind of policy ({kind_names()})" if has_card(contents) else ""
    return f"is not a checkpoint of drivezoo{kinds}; name one from a run of drivezoo train"


def load_plain(path: Path) -> Any:
    """Return the contents of a torch file that holds only plain containers and tensors.

    Raises:
        InputError: the file cannot be read, is empty, truncated, damaged or not from torch, or
            contains code, which is not run.
    """
    with (
        file_errors(path, "cannot be read ({}); name another file"),
        open_binary(path, MOST_BYTES) as file,
    ):
        return _load_plain(file, path)


def _load_plain(file: BinaryIO, path: Path) -> object:
    """Return the contents of an opened torch file.

    The path is only text for messages: it may lead to another file by now.

    Raises:
        InputError: see `load_plain`.
        OSError: the file cannot be read.
    """
    if not file.seek(0, io.SEEK_END):
        raise InputError(f"{path}: is empty (0 bytes); copy it again")
    kind = torch_kind(file)
    if not kind:
        what = describe_network(path) or f"is not a torch file; {_ANOTHER}"
        raise InputError(f"{path}: {what}")
    if kind == SCRIPT:
        raise InputError(f"{path}: {describe_script(path)}")
    file.seek(0)
    is_zip = file.read(2) == b"PK"  # else a pickle, as torch wrote before 1.6
    try:
        if is_zip and not zipfile.is_zipfile(file):  # which raises an error for a damaged end
            raise InputError(f"{path}: is truncated: it has no end; copy it again, or {_ANOTHER}")
        check_pickles(*_first_pickles(file, path, is_zip))
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch warns of unusual pickles, then refuses them
            contents = torch.load(file, map_location="cpu", weights_only=True)
        check_text(contents, any_path=True)
    except pickle.UnpicklingError:
        raise InputError(
            f"{path}: is damaged or contains code, which was not run; name a checkpoint of "
            "drivezoo train, or a file to which its own program saved only a state_dict()"
        ) from None
    except InputError:
        raise
    except Exception as error:  # the unpickler raises any error on damaged bytes
        words = " ".join(str(error).split())
        reason = words if type(error) is ValueError else type(error).__name__
        raise InputError(
            f"{path}: is damaged, or not a torch file ({reason:.200}); copy it again, or {_ANOTHER}"
        ) from None
    tensors = (value for _, value in leaves(contents) if isinstance(value, Tensor))
    # A view counts as a copy.
    check_unpacked(sum(tensor.numel() * tensor.element_size() for tensor in tensors), size, path)
    return contents


def _first_pickles(file: BinaryIO, path: Path, is_zip: bool) -> tuple[bytes, int]:
    """Return the pickle in a torch file, or the begin of one before 1.6, and their number."""
    if not is_zip:
        file.seek(0)
        return file.read(MOST_PICKLE_BYTES), 5
    with open_archive(file, path) as archive:
        name = next(name for name in archive.namelist() if name.endswith("/data.pkl"))
        with archive.open(name) as member:
            return member.read(MOST_PICKLE_BYTES), 1


_ANOTHER = "name another checkpoint, such as last.ckpt in the same folder"


def load_checkpoint(path: str | Path) -> Checkpoint:
    """Return a checkpoint's network, view and config.

    Args:
        path: checkpoint file, run's folder, or `latest`; see `find_checkpoint`.

    Raises:
        InputError: see `find_checkpoint` and `read_checkpoint_file`; or the weights do not fit the
            network that the config names, or are not finite.
    """
    path = find_checkpoint(path)
    return build_checkpoint(read_checkpoint_file(path), path)


def build_checkpoint(contents: dict, path: Path) -> Checkpoint:
    """Return the checkpoint of a file's contents; see `load_checkpoint`."""
    card = contents["drivezoo"]
    check_card(card, path)
    changed = check_part(card, path)
    state = checked_state(contents["state_dict"], path)
    state = {
        key.removeprefix(PREFIX): tensor for key, tensor in state.items() if key.startswith(PREFIX)
    }
    most = SPARE_PARAMETERS + sum(tensor.numel() for tensor in state.values())
    try:
        view = View.from_dict(card["view"])
        network = make_network(card["config"]["model"], view, most)
    except (InputError, RuntimeError, KeyError, TypeError) as error:
        reason = str(error).splitlines()[0][:300]
        raise InputError(f"{path}: its network cannot be built ({reason}); {_ANOTHER}") from None
    what = changed or "its config"
    fix = f"{what} was changed after the training; restore it, or {_ANOTHER}"
    check_fit(network.state_dict(), state, type(network).__name__, path, fix)
    network.load_state_dict(state)
    data = card["data"] | {key: card[key] for key in [STARTED_IN] if key in card}
    if rig := added_rig(path):
        data = {**data, "source": None if rig == UDACITY else rig.name, "rig": rig.name}
    return Checkpoint(network.eval(), view, card["config"], data)


def added_rig(path: str | Path) -> Rig | None:
    """Return the rig that a user added to the run's folder of a checkpoint; None without one.

    Raises:
        InputError: see `zoo.base.rig_file.read_rig`.
    """
    folder = Path(path).absolute().parent
    return find_rig(folder.parent) if folder.name == FOLDER else None


def checked_state(state: object, path: Path) -> dict[str, Tensor]:
    """Return a file's contents, checked to be a state dict.

    Raises:
        InputError: the contents are not a state dict.
    """
    if not isinstance(state, dict) or not all(
        isinstance(name, str) and isinstance(tensor, Tensor) and not tensor.is_meta
        for name, tensor in state.items()
    ):
        raise InputError(f"{path}: is not a state dict; save the model's state_dict()")
    return state


def check_fit(
    needed: dict[str, Tensor], state: dict[str, Tensor], kind: str, path: Path, fix: str
) -> None:
    """Check that a file's tensors fit a network and are finite.

    Args:
        needed: network's tensors, by name.
        state: file's tensors, by name.
        kind: network's class, for the message.
        path: file, for the message.
        fix: remedy to print when a tensor has another shape than the network's.

    Raises:
        InputError: names the first tensor that is missing or unknown, has another shape or dtype,
            or is not finite.
    """
    for name in [*needed, *state]:
        if reason := _misfit(name, needed.get(name), state.get(name), kind, fix):
            raise InputError(f"{path}: {reason}")


def _misfit(name: str, needed: Tensor | None, saved: Tensor | None, kind: str, fix: str) -> str:
    """Return why a file's tensor does not fit a network's, and the remedy; empty if it does."""
    if saved is None:
        return f"lacks {name}, which {kind} needs; name a file of the same model"
    if needed is None:
        return f"holds {name}, which {kind} lacks; name a file of the same model"
    if saved.shape != needed.shape:
        return f"{name} is {list(saved.shape)} in the file, {list(needed.shape)} in {kind}; {fix}"
    # Of 8 bits, torch's floats lack most functions.
    dtypes = FLOATS if needed.is_floating_point() else (needed.dtype,)
    if saved.layout != torch.strided or saved.dtype not in dtypes:
        return f"{name} does not hold plain floats; save the model's state_dict()"
    if torch.isfinite(saved).all():
        return ""
    return (
        f"{name} holds NaN or infinity: the training diverged; train again with a smaller "
        "optim.lr, or name an earlier checkpoint"
    )


def check_card(card: object, path: Path) -> None:
    """Raise InputError for the first wrong field of a card."""
    check_fields(Card, card, f"{path}: drivezoo")


def part_cards(config: dict) -> list[dict[str, str]]:
    """Return module, name and hash of each part whose classes a config names."""
    targets = (str(value) for keys, value in leaves(config) if keys[-1:] == ("_target_",))
    parts = {target: part for target in targets if (part := part_of(target))}
    modules = {target.rpartition(".")[0]: (target, part) for target, part in parts.items()}
    return [
        {"module": module, "name": part.name, "sha256": _hash_of(target, part)}
        for module, (target, part) in sorted(modules.items())
    ]


def check_part(card: dict, path: Path) -> str | None:
    """Check the part that defines a checkpoint's network, and print where it has changed.

    Args:
        card: card of the checkpoint.
        path: checkpoint, for messages.

    Returns:
        The part's name if it has changed since the training; else None.

    Raises:
        InputError: the user has not named the part.
    """
    target = card["config"]["model"].get("_target_")
    module = str(target).rpartition(".")[0]
    entries = (entry for entry in card.get("parts") or () if entry["module"] == module)
    entry = next(entries, None)
    if entry is None:
        return None
    part = part_of(target)
    if part is None:
        raise InputError(
            f"{path}: its network {target:.200} is from {entry['name']:.100}, outside drivezoo; "
            f"{unknown_part(target)}"
        )
    if entry["sha256"] == _hash_of(target, part):
        return None
    if multiprocessing.parent_process() is None:  # else the parent has printed it
        line = f"{part.name} has changed since this network was trained; it is used as it is now"
        print(error_line(str(path), line), file=sys.stderr, flush=True)
    return part.name


def _hash_of(target: str, part: Part) -> str:
    """Return sixteen hexadecimal digits of the file that defines a class."""
    file = part.file
    if file is None:
        kind = part_class(target)
        file = Path(getattr(sys.modules[kind.__module__], "__file__", "") if kind else "")
    try:
        return hash_file(file)[:16]
    except (OSError, InputError):
        return ""
