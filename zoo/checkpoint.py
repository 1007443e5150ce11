"""Checkpoints: self-contained, plain containers only, and read without running what is in them."""

import importlib
import pickle
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from datamodules.errors import InputError
from datamodules.view import View

FORMAT = 1
PREFIX = "network."  # how the LightningModule calls the network in its state
VIEW_KEYS = ("colour", "size")
# Of a model's config, not for its constructor.
BORDER_KEYS = (*VIEW_KEYS, "weights", "name", "cache_features")


@dataclass(frozen=True)
class Checkpoint:
    """What a checkpoint holds for whoever drives or goes on training.

    Attributes:
        network: ready, in evaluation mode, on the CPU.
        view: what it must be fed.
        config: the experiment's whole config, plain.
        data: the recording's `fingerprint` and number of `rows`.
    """

    network: nn.Module
    view: View
    config: dict
    data: dict


def make_card(config: dict, view: View, data: dict) -> dict:
    """What every checkpoint carries beside the weights, under the key `drivezoo`."""
    return {"format": FORMAT, "config": config, "view": view.to_dict(), "data": data}


def read_checkpoint_file(path: str | Path) -> dict:
    """The plain contents of a checkpoint of ours.

    Raises:
        InputError: no such file, not a checkpoint, one that carries code, or another program's.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint; a run leaves checkpoints/best.ckpt")
    contents = load_plain(path)
    card = contents.get("drivezoo") if isinstance(contents, dict) else None
    if not isinstance(card, dict) or "state_dict" not in contents:
        raise InputError(f"{path}: is not a checkpoint of drivezoo; use one of python -m zoo")
    if card.get("format") != FORMAT:
        raise InputError(
            f"{path}: has format {card.get('format')}, this version reads {FORMAT}; "
            "use the drivezoo that wrote it"
        )
    return contents


def load_plain(path: Path) -> object:
    """What `torch.load` finds in a file of plain containers and tensors, and of nothing else.

    Raises:
        InputError: the file is damaged, is not torch's, or carries code, which is not run.
    """
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:
        raise InputError(
            f"{path}: refused, it is damaged or carries code, and none of it was run; use a "
            "checkpoint of python -m zoo, or a state_dict() saved alone"
        ) from None
    except Exception:  # bytes of any kind make the unpickler fail in any way
        raise InputError(f"{path}: is no file of torch, or a truncated one") from None


def load_checkpoint(path: str | Path) -> Checkpoint:
    """The network of a checkpoint, its view and its config; needs nothing but the path.

    Raises:
        InputError: see `read_checkpoint_file`; or the weights do not fit the network named.
    """
    contents = read_checkpoint_file(path)
    card = contents["drivezoo"]
    try:
        view = View.from_dict(card["view"])
        network = make_network(card["config"]["model"], view)
        weights = contents["state_dict"].items()
        network.load_state_dict(
            {name[len(PREFIX) :]: tensor for name, tensor in weights if name.startswith(PREFIX)}
        )
    except (InputError, RuntimeError, KeyError, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: cannot be made into a network ({reason})") from None
    return Checkpoint(network.eval(), view, card["config"], card["data"])


def make_network(model: dict, view: View) -> nn.Module:
    """The network that a model's config names, for a view. Its `_target_` must be in `zoo.models`:
    a config can come from a stranger's checkpoint, and must not name any callable there is.

    Raises:
        InputError: a target that is no network of the zoo, or settings that it refuses.
    """
    target = str(model.get("_target_"))
    module_name, _, class_name = target.rpartition(".")
    network_class = None
    if module_name.startswith("zoo.models."):
        try:
            network_class = getattr(importlib.import_module(module_name), class_name, None)
        except ImportError:
            network_class = None
    if not (isinstance(network_class, type) and issubclass(network_class, nn.Module)):
        raise InputError(f"model._target_={target} is no network of zoo.models")
    settings = {key: value for key, value in model.items() if key not in ("_target_", *BORDER_KEYS)}
    height, width, channels = view.shape
    try:
        return network_class((channels, height, width), **settings)
    except (TypeError, ValueError) as error:
        raise InputError(str(error)) from None
