"""Keras 2 files of small networks that steer, and of PilotNets that drivezoo trained."""

import base64
import json
import marshal
from collections.abc import Callable, Sequence
from pathlib import Path

import h5py
import numpy as np
from torch import nn

from datamodules.image import read_image
from datamodules.recording import Recording
from datamodules.view import View

RIDGE = 10.0
Layer = tuple[str, dict, list[np.ndarray]]  # class, config, arrays


def write_h5(path: Path, layers: Sequence[Layer], shape: Sequence[int | None]) -> Path:
    """Write a `.h5` file as Keras 2's `model.save`.

    Args:
        path: file to write.
        layers: class, config and arrays of each layer.
        shape: shape of an image, with the channels last.
    """
    with h5py.File(path, "w") as file:
        group = file.create_group("model_weights")
        for place in (file, group):
            place.attrs["keras_version"], place.attrs["backend"] = b"2.0.6", b"tensorflow"
        configs, names = [], []
        for number, (kind, config, arrays) in enumerate(layers, start=1):
            name = f"{kind.lower()}_{number}"
            first = {"batch_input_shape": [None, *shape]} if number == 1 else {}
            configs.append({"class_name": kind, "config": {"name": name, **first, **config}})
            names.append(name)
            own = group.create_group(name)
            ends = ("kernel:0", "bias:0")
            weights = [f"{name}/{end}" for end in ends[: len(arrays)]]
            own.attrs["weight_names"] = np.array(weights, "S")
            for weight, array in zip(weights, arrays, strict=True):
                own.create_dataset(weight, data=array)
        group.attrs["layer_names"] = np.array(names, "S")
        model = {"class_name": "Sequential", "config": configs}
        file.attrs["model_config"] = json.dumps(model).encode()
    return path


def lambda_layer(function: Callable) -> Layer:
    """Return a Lambda with a function's code, as Keras 2 saves it."""
    code = base64.b64encode(marshal.dumps(function.__code__)).decode()
    return "Lambda", {"function": [code, None, None], "function_type": "lambda"}, []


def conv_layer(kernel: np.ndarray, bias: np.ndarray, stride: int, activation: str) -> Layer:
    """Return a Conv2D with a kernel [rows, columns, in, out]."""
    config = {
        "filters": kernel.shape[3],
        "kernel_size": list(kernel.shape[:2]),
        "strides": [stride, stride],
        "padding": "valid",
        "data_format": "channels_last",
        "activation": activation,
        "use_bias": True,
    }
    return "Conv2D", config, [kernel, bias]


def dense_layer(kernel: np.ndarray, bias: np.ndarray, activation: str = "linear") -> Layer:
    """Return a Dense with a kernel [in, out]."""
    config = {"units": kernel.shape[1], "activation": activation, "use_bias": True}
    return "Dense", config, [kernel, bias]


def pilotnet_layers(network: nn.Module, before: Sequence[Layer]) -> list[Layer]:
    """Return the layers of a `PilotNet`, after those that are given, such as a Lambda."""
    layers, channels = list(before), None
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            kernel = module.weight.detach().numpy().transpose(2, 3, 1, 0)
            layers.append(conv_layer(kernel, module.bias.detach().numpy(), module.stride[0], "elu"))
            channels = module.out_channels
        elif isinstance(module, nn.Linear):
            kernel = module.weight.detach().numpy()
            if channels:  # torch flattens (channels, pixels), Keras (pixels, channels)
                layers.append(("Flatten", {}, []))
                kernel = kernel.reshape(len(kernel), channels, -1).transpose(0, 2, 1)
                kernel, channels = kernel.reshape(len(kernel), -1), None
            activation = "elu" if module.out_features > 1 else "linear"
            layers.append(dense_layer(kernel.T, module.bias.detach().numpy(), activation))
    return layers


def fit_steering(recording: Recording, view: View, scale: tuple[float, float]) -> Layer:
    """Return a Dense of a linear regression from views, scaled, to the steering.

    The side cameras' images are samples, too, so that the network steers back to the centre.
    """
    offsets = (0.0, 0.25, -0.25)
    images = [view(read_image(path)) for row in recording.images for path in row]
    inputs = np.stack(images).reshape(len(images), -1) / scale[0] - scale[1]
    steering = (recording.steering[:, None] + offsets).ravel()
    middle = inputs.mean(0)
    centred = inputs - middle
    # Ridge regression in its dual form: there are fewer images than pixels.
    weights = centred.T @ np.linalg.solve(
        centred @ centred.T + RIDGE * np.eye(len(images)), steering
    )
    bias = -middle @ weights
    return dense_layer(
        weights.astype(np.float32)[:, None], np.array([bias], np.float32), activation="linear"
    )


def write_steering_h5(path: Path, recording: Recording, view: View, *before: Layer) -> Path:
    """Write a linear network that steers by a view of -1..1, after other layers."""
    layers = [*before, ("Flatten", {}, []), fit_steering(recording, view, (127.5, 1.0))]
    return write_h5(path, layers, view.shape)
