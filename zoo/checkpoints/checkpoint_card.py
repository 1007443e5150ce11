"""The typed card that a checkpoint holds under the key `drivezoo`, besides its weights.

A card names the user's parts by module and hash, but does not choose the code that runs: the user
names the part, see `zoo.base.parts`.
"""

import hashlib
import multiprocessing
import sys
from collections.abc import Iterator
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.parts import Part, part_class, part_of, unknown_part
from zoo.base.terminal import error_line
from zoo.runs.record_fields import Fields, Number, Whole, check_fields


class Config(Fields):
    """The experiment's config."""

    model: dict[str, object]
    data: dict[str, object] | None = None


class View(Fields):
    """The network's view; `datamodules.view.View` checks the values."""

    crop: list[Whole]
    colour: str
    size: list[Whole] | None
    resize: str
    frame: list[Whole] | None = None


class Data(Fields):
    """The recording's rows."""

    fingerprint: str | None = None
    rows: Whole | None = None
    rows_per_s: Number | None = None
    speed_mph: Number | None = None
    split_by: str | None = None
    curvature_per_m: Number | None = None  # see `zoo.base.rig.SteeringLabel`
    source: str | None = None  # its other car or format; None for Udacity's rig


class PartCard(Fields):
    """A part of the user's that the config names, see `part_cards`."""

    module: str
    name: str
    sha256: str


class Card(Fields):
    """A card, as `zoo.checkpoints.checkpoint.make_card` returns it."""

    config: Config
    view: View
    data: Data
    parts: list[PartCard] | None = None  # only where there are some


def check_card(card: object, path: Path) -> None:
    """Raise InputError for the first wrong field of a card."""
    check_fields(Card, card, f"{path}: drivezoo")


def part_cards(config: dict) -> list[dict[str, str]]:
    """Return module, name and hash of each part whose classes a config names."""
    parts = {target: part for target in _targets(config) if (part := part_of(target))}
    found = {target.rpartition(".")[0]: (target, part) for target, part in parts.items()}
    return [
        {"module": module, "name": part.name, "sha256": _hash_of(target, part)}
        for module, (target, part) in sorted(found.items())
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
    known = [one for one in card.get("parts") or () if one["module"] == module]
    if not known:
        return None
    part = part_of(target)
    if part is None:
        raise InputError(
            f"{path}: its network {target:.200} is from {known[0]['name']:.100}, outside drivezoo; "
            f"{unknown_part(target)}"
        )
    if known[0]["sha256"] == _hash_of(target, part):
        return None
    if multiprocessing.parent_process() is None:  # else the parent has printed it
        line = f"{part.name} has changed since this network was trained; it is used as it is now"
        print(error_line(str(path), line), file=sys.stderr, flush=True)
    return part.name


def _hash_of(target: str, part: Part) -> str:
    """Return sixteen hexadecimal digits of the file that defines a class."""
    file = part.file
    if file is None:
        found = part_class(target)
        file = Path(getattr(sys.modules[found.__module__], "__file__", "") if found else "")
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
    except OSError:
        return ""


def _targets(node: object) -> Iterator[str]:
    """Yield every `_target_` within plain containers."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key == "_target_" and isinstance(value, str):
                yield value
            else:
                yield from _targets(value)
    elif isinstance(node, list):
        for one in node:
            yield from _targets(one)
