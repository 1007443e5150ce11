"""A checkpoint as a Keras file that Donkeycar's `manage.py drive --model` loads.

A `.keras` file is that of `zoo.extras.car.keras_zip`. A `.h5` file of Keras 2 has the architecture
of a functional model and its weights in the layout of Keras' legacy HDF5 format
(`saving/legacy/hdf5_format.py`). Crop, colour and size of the view are layers of both.
"""

import copy
import io
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from datamodules.view import View
from zoo.base.errors import InputError
from zoo.base.rig import DONKEYCAR_OUTPUTS
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.network_files import read_network
from zoo.extras.car.keras_zip import Layer, resizing_layers, zip_bytes
from zoo.models.layers import Crop, InKerasOrder, Normalize, Unbin
from zoo.models.memory import Memory
from zoo.models.network_facts import NetworkFacts, facts_of

WAYS = {"linear": "bilinear", "area": "area"}
ACTIVATIONS = {nn.ReLU: "relu", nn.ELU: "elu", nn.Tanh: "tanh", nn.Sigmoid: "sigmoid"}
NEVER = -1e9  # value of a bin that is never the largest
IGNORED = (nn.Flatten, nn.Identity, nn.Dropout)  # flattening has its place before a dense layer
# OpenCV's RGB to YUV of values 0..1: a row for each channel, and what is added to it.
YUV = np.array([[0.299, 0.587, 0.114], [-0.147, -0.289, 0.436], [0.615, -0.515, -0.1]])
YUV_OFFSET = np.array([0.0, 128 / 255, 128 / 255])
COLOURS = {
    "bgr": (np.eye(3)[::-1], np.zeros(3)),
    "gray": (YUV[:1], np.zeros(1)),
    "yuv": (YUV, YUV_OFFSET),
    "yuv_old": (YUV[:, ::-1], YUV_OFFSET),
}


class BoundedThrottle(nn.Sequential):
    """A network, and layers that return its steering and a bounded throttle."""

    facts = NetworkFacts(outputs=2)


def bounded(checkpoint: Checkpoint, most: float) -> Checkpoint:
    """Return a checkpoint whose throttle is at most `most`; always that if it only steers.

    A network of bins gets the best of the bins up to it.
    """
    network = copy.deepcopy(checkpoint.network)
    layers: list[nn.Module] = [network]
    bins = bins_of(network)
    with torch.no_grad():
        if bins and [*network.modules()][-1] is bins[0]:
            steering, (count, low, step) = bins[0].groups
            last = [module for module in network.modules() if isinstance(module, nn.Linear)][-1]
            above = low + step * torch.arange(count) > most + 1e-6
            last.weight[steering[0] :][above] = 0
            last.bias[steering[0] :][above] = NEVER
            return replace(checkpoint, network=network)
        if facts_of(network).outputs == 1:
            signs = torch.tensor([[1.0], [0.0]])
        else:  # s = relu(s) - relu(-s), and the throttle = most - relu(most - throttle)
            signs = torch.tensor([[1.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
            first = nn.Linear(2, 3)
            first.weight.copy_(signs.T)
            first.bias.copy_(torch.tensor([0.0, 0.0, most]))
            layers += [first, nn.ReLU()]
        last = nn.Linear(signs.shape[1], 2)
        last.weight.copy_(signs)
        last.bias.copy_(torch.tensor([0.0, most]))
    return replace(checkpoint, network=BoundedThrottle(*layers, last).eval())


def inferred_throttle(steering: Sequence[float]) -> list[float]:
    """Return the throttle that Donkeycar computes from the steering: `donkeycar.utils.throttle`."""
    share = (np.array(steering) + 1) / 2
    return (np.exp(-0.5 * share) - 0.05 * share).tolist()


def donkeycar_bytes(checkpoint: Checkpoint, keras: int = 2) -> tuple[bytes, str]:
    """Return a checkpoint as a `.h5` file of Keras 2 or a `.keras` file of Keras 3, and its type.

    Donkeycar's type of the model is `linear` for steering and throttle, `categorical` for both in
    bins, and `inferred` for the steering alone, from which Donkeycar computes the throttle.

    Raises:
        InputError: the network takes more than an image, or a layer or the view has no counterpart
            in Keras.
    """
    network = checkpoint.network
    trained = network[0] if isinstance(network, BoundedThrottle) else network
    name = type(trained).__name__
    if isinstance(trained, Memory) or facts_of(trained).takes_speed:
        raise InputError(f"{name} takes more than an image, which Donkeycar does not pass to it")
    resizing, contents = FORMS[keras]
    layers = [*_view_layers(checkpoint.view, resizing), *_network_layers(network, name)]
    kind, config, weights = layers.pop()
    units = [1] * facts_of(network).outputs
    bins = bins_of(network)
    if bins:
        units = [group[0] for group in bins[0].groups]
        config["activation"] = "softmax"
    if kind != "Dense" or config["units"] != sum(units):
        raise InputError(
            f"{name}: its last layer is not one dense layer of its outputs, such as with steering= "
            "of drivezoo import after bins; name another kind of file, such as out=model.onnx"
        )
    names = DONKEYCAR_OUTPUTS[2] if bins else DONKEYCAR_OUTPUTS[0]
    parts = zip(
        *(np.split(weight, np.cumsum(units)[:-1], axis=-1) for weight in weights), strict=True
    )
    layers += [
        (kind, config | {"name": name, "units": count}, list(part))
        for name, count, part in zip(names, units, parts, strict=False)
    ]
    model_type = "categorical" if bins else ("inferred", "linear")[len(units) - 1]
    return contents(layers, len(units), (*checkpoint.view.frame, 3)), model_type


def bins_of(network: nn.Module) -> list[Unbin]:
    """Return the layer of a network that reads bins, if it has one."""
    return [module for module in network.modules() if isinstance(module, Unbin)]


def whole_view(view: View) -> View:
    """Return the view of Donkeycar's frames, without crop and colour; a view's frames have it."""
    return View((0, 0), "rgb", None, frame=view.frame)


def donkeycar_policy(checkpoint: Checkpoint, path: Path) -> CheckpointPolicy:
    """Return the policy of a written file, as `drivezoo import` reads it."""
    network, view = read_network(path), whole_view(checkpoint.view)
    for read, own in zip(bins_of(network), bins_of(checkpoint.network), strict=True):
        read.groups = own.groups  # no file says how fast its bins are
    return CheckpointPolicy(replace(checkpoint, network=network, view=view))


def _view_layers(view: View, resizing: Callable[[View], list[Layer]]) -> list[Layer]:
    """Return the layers that compute a view of a frame, without rounding to whole numbers."""
    layers: list[Layer] = []
    if view.colour in COLOURS:
        matrix, offset = COLOURS[view.colour]
        config = {"filters": len(matrix), "kernel_size": [1, 1]}
        layers.append(("Conv2D", config, [matrix.T[None, None], offset]))
        if view.colour.startswith("yuv"):  # whose values OpenCV limits
            layers.append(("ReLU", {"max_value": 1.0}, []))
    elif view.colour != "rgb":
        raise InputError(f"colour={view.colour}: Keras has no layer for it; train with rgb or yuv")
    resized = resizing(view) if view.size else []
    crop: Layer = ("Cropping2D", {"cropping": [list(view.rows_cropped(view.frame[0])), [0, 0]]}, [])
    if view.resize.endswith("_first"):
        return [crop, *resized, *layers]
    return [crop, *layers, *resized]


def _h5_resizing(view: View) -> list[Layer]:
    config = dict(zip(("height", "width"), view.size or (), strict=True))
    way = WAYS.get(view.resize.removesuffix("_first"))
    if way is None:
        raise InputError(f"resize={view.resize}: Keras has no layer for it; train with linear")
    return [("Resizing", config | {"interpolation": way}, [])]


def _network_layers(network: nn.Module, name: str) -> list[Layer]:
    """Return the layers of a network whose modules are called in their order.

    Raises:
        InputError: a module has no counterpart; names its class.
    """
    layers: list[Layer] = []
    channels, is_image = 1, True
    for module in _leaves(network):
        if isinstance(module, nn.Linear):
            kernel = _array(module.weight)
            if is_image:  # torch flattens to (channels, pixels), Keras to (pixels, channels)
                layers.append(("Flatten", {}, []))
                kernel = kernel.reshape(len(kernel), channels, -1).transpose(0, 2, 1)
                kernel, is_image = kernel.reshape(len(kernel), -1), False
            bias = _array(module.bias) if module.bias is not None else np.zeros(len(kernel))
            layers.append(("Dense", {"units": len(kernel)}, [kernel.T, bias]))
        elif isinstance(module, InKerasOrder) and isinstance(module.layer, nn.Flatten):
            layers.append(("Flatten", {}, []))
            is_image = False
        elif type(module) is nn.Conv2d and module.groups == 1 and module.padding == (0, 0):
            channels = module.out_channels
            bias = _array(module.bias) if module.bias is not None else np.zeros(channels)
            config = {"filters": channels, "kernel_size": list(module.kernel_size)}
            config |= {"strides": list(module.stride), "dilation_rate": list(module.dilation)}
            layers.append(("Conv2D", config, [_array(module.weight).transpose(2, 3, 1, 0), bias]))
        elif _is_activation(module) and layers[-1][2] and "activation" not in layers[-1][1]:
            layers[-1][1]["activation"] = ACTIVATIONS[type(module)]
        elif isinstance(module, Normalize):  # of pixels; Donkeycar divides them by 255
            config = {"scale": 255 / module.divisor, "offset": -module.shift}
            layers.append(("Rescaling", config, []))
        elif type(module) is nn.MaxPool2d and not module.padding:
            config = {"pool_size": module.kernel_size, "strides": module.stride}
            layers.append(("MaxPooling2D", config, []))
        elif isinstance(module, Crop):
            edges = [[module.top, module.bottom], [module.left, module.right]]
            layers.append(("Cropping2D", {"cropping": edges}, []))
        elif not isinstance(module, (*IGNORED, Unbin)):
            raise InputError(
                f"{name}: its layer {type(module).__name__} cannot be written "
                "for Donkeycar; train model=lenet or nvidia, or a network of Donkeycar"
            )
    return layers


def _is_activation(module: nn.Module) -> bool:
    """Return whether Keras computes a module by a name; it does an ELU of alpha 1 alone."""
    return type(module) in ACTIVATIONS and getattr(module, "alpha", 1.0) == 1.0


def _leaves(module: nn.Module) -> Iterator[nn.Module]:
    """Yield the modules without parts in their order; `InKerasOrder` counts as one."""
    if isinstance(module, InKerasOrder) or not list(module.children()):
        yield module
        return
    for child in module.children():
        yield from _leaves(child)


def _array(tensor: Any) -> np.ndarray:
    return tensor.detach().numpy()


def _file_bytes(layers: list[Layer], ends: int, shape: tuple[int, ...]) -> bytes:
    """Return a `.h5` file whose last `ends` layers all take the output of the layer before them."""
    import h5py  # optional, checked before

    start = {"name": "img_in", "batch_input_shape": [None, *shape], "dtype": "float32"}
    entries: list[dict[str, Any]] = [
        {"class_name": "InputLayer", "name": "img_in", "config": start, "inbound_nodes": []}
    ]
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        group = file.create_group("model_weights")
        for number, (kind, config, weights) in enumerate(layers):
            name = config.get("name", f"{kind.lower()}_{number}")
            before = entries[min(number, len(layers) - ends)]["name"]
            entry = {"class_name": kind, "name": name, "config": {"name": name} | config}
            entries.append(entry | {"inbound_nodes": [[[before, 0, 0, {}]]]})
            paths = [f"{name}/{end}:0" for end in ("kernel", "bias")][: len(weights)]
            layer = group.create_group(name)
            layer.attrs["weight_names"] = [path.encode() for path in paths]
            for path, array in zip(paths, weights, strict=True):
                layer.create_dataset(path, data=array.astype(np.float32))
        names = [entry["name"] for entry in entries]
        model = {"name": "drivezoo", "layers": entries, "input_layers": [["img_in", 0, 0]]}
        model["output_layers"] = [[name, 0, 0] for name in names[-ends:]]
        group.create_group("img_in").attrs["weight_names"] = np.array([], "S")
        group.attrs["layer_names"] = [name.encode() for name in names]
        for attributes in (file.attrs, group.attrs):
            attributes["keras_version"], attributes["backend"] = b"2.15.0", b"tensorflow"
        file.attrs["model_config"] = json.dumps({"class_name": "Functional", "config": model})
    return buffer.getvalue()


# By the version of Keras: how a view is resized, and the writer of a file.
FORMS = {2: (_h5_resizing, _file_bytes), 3: (resizing_layers, zip_bytes)}
