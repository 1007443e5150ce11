"""Files of networks that Keras and other frameworks wrote, for checkpoints and `model.weights`.

The module is an entry point of the group `drivezoo.weights`, see `zoo.checkpoints.network_files`.
"""

from __future__ import annotations

from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.errors import InputError
from zoo.extras.keras.network_kind import IMPORTED, describe_kind, network_kind

if TYPE_CHECKING:
    from torch import nn  # a slow import, as those in the functions

SAME = 1e-3  # largest difference of outputs that rounding explains


def detect(path: Path) -> bool:
    """Return whether a file or folder holds a network or weights of Keras."""
    return network_kind(path) in IMPORTED


def describe(path: Path) -> str:
    """Return what a file or folder is and what to do with it; empty if it is unknown."""
    kind = network_kind(path)
    return describe_kind(path, kind) if kind else ""


def load(network: nn.Module, path: Path) -> str:
    """Load the weights of a Keras file into a network; the layers of `Sequential` are the file's.

    Raises:
        InputError: the file is damaged, or does not fit the network.
    """
    import torch

    from zoo.checkpoints.checkpoint import check_fit
    from zoo.extras.keras.keras_file import read_keras_apart
    from zoo.extras.keras.keras_layers import convert
    from zoo.extras.keras.keras_weights import load_keras_weights
    from zoo.extras.keras.sequential import Sequential
    from zoo.models.memory import frame_outputs

    if not isinstance(network, Sequential):
        text, told = load_keras_weights(network, path), None
        # Passed over: weights alone, an unclear layer, another size of the input.
        with suppress(InputError, RuntimeError), torch.random.fork_rng([]), torch.inference_mode():
            file = convert(read_keras_apart(path))
            images = torch.randint(0, 256, (8, file.input_shape[2], *file.input_shape[:2]))
            outputs = frame_outputs(deepcopy(network).eval(), images, torch.zeros(8))
            most, told = float((outputs - file.network.eval()(images)).abs().max()), file.scale
            if told and most > SAME:
                text += f"; its own layers, of scale {told}, steer otherwise, by {most:.1g}"
        return text if told else f"{text}; the scale of its pixels is unknown"
    model = read_keras_apart(path)
    state = convert(model, scale=network.scale).state
    fix = "set model.layers=null for the file's own layers"
    check_fit(network.state_dict(), state, "model.layers", path, fix)
    network.load_state_dict(state)
    count = sum(1 for layer in model.layers if layer.arrays)
    return f"{count} layers from {path} (Keras {model.version})"


def read(path: Path) -> nn.Module:
    """Return the network of a Keras file, as `drivezoo import` converts it.

    Raises:
        InputError: the file is damaged, or a layer cannot be converted.
    """
    from zoo.extras.keras.keras_file import read_keras_apart
    from zoo.extras.keras.keras_layers import convert

    return convert(read_keras_apart(path)).network.eval()
