"""Files in the layouts of Keras 1, 2 and 3, written without Keras."""

import base64
import io
import json
import marshal
import zipfile
from pathlib import Path
from types import FunctionType

import h5py
import numpy as np

Layer = tuple[str, dict, list]  # class, config, weights
INPUT = (20, 30, 3)
# The names of a class's weights in a file.
ENDS = {
    "BatchNormalization": ["gamma", "beta", "moving_mean", "moving_variance"],
    "SeparableConv2D": ["depthwise_kernel", "pointwise_kernel", "bias"],
    "PReLU": ["alpha"],
}
USUAL = ["kernel", "bias"]
KERAS_1 = {"kernel": "W", "bias": "b"}


def random_weights(*shapes: tuple[int, ...], seed: int = 0) -> list[np.ndarray]:
    """Return arrays of random values; those of one axis are above 0, as a variance must be."""
    rng = np.random.default_rng(seed)
    return [
        rng.uniform(0.2, 1, shape).astype(np.float32)
        if len(shape) == 1
        else (rng.normal(size=shape) / np.sqrt(np.prod(shape[:-1]))).astype(np.float32)
        for shape in shapes
    ]


def named_layers(layers: list[Layer]) -> list[tuple[str, str, dict, list]]:
    """Return layers with their own names, or as Keras gives them: `conv2d_1`, `conv2d_2` ..."""
    counts: dict[str, int] = {}
    entries = []
    for kind, config, weights in layers:
        counts[kind] = counts.get(kind, 0) + 1
        name = config.get("name", f"{kind.lower()}_{counts[kind]}")
        entries.append((name, kind, config, weights))
    return entries


def model_config(layers: list[Layer], shape: tuple | None = INPUT, version: int = 2) -> dict:
    """Return the config of a Sequential model; Keras 1 has a list of layers."""
    entries = []
    for name, kind, config, _ in named_layers(layers):
        settings = {"name": name} | config
        if not entries and shape is not None and version < 3:
            settings = {"batch_input_shape": [None, *shape]} | settings
        entries.append({"class_name": kind, "config": settings})
    if version >= 3 and shape is not None:
        config = {"name": "input_layer", "batch_shape": [None, *shape]}
        entries.insert(0, {"class_name": "InputLayer", "config": config})
    return {
        "class_name": "Sequential",
        "config": entries if version == 1 else {"name": "sequential_1", "layers": entries},
    }


def functional(layers: list[Layer], version: int = 2, ends: int = 1, shape: tuple = INPUT) -> dict:
    """Return the config of a functional model whose layers are not in the order of the data.

    Args:
        layers: layers in the order of the data.
        version: Keras' major version.
        ends: number of the last layers that all take the output of the layer before them.
        shape: shape of the images.
    """
    config = model_config(layers, shape, version)
    entries = config["config"]["layers"]
    if version == 2:
        del entries[0]["config"]["batch_input_shape"]
        start = {"name": "input_1", "batch_input_shape": [None, *shape]}
        entries.insert(0, {"class_name": "InputLayer", "config": start})
    names = [entry["config"]["name"] for entry in entries]
    for number, entry in enumerate(entries):
        entry["name"] = names[number]
        before = names[min(number, len(names) - ends) - 1]
        history = {"class_name": "__keras_tensor__", "config": {"keras_history": [before, 0, 0]}}
        old, new = [[[before, 0, 0, {}]]], [{"args": [history], "kwargs": {}}]
        entry["inbound_nodes"] = [] if number == 0 else old if version == 2 else new
    config["class_name"] = "Model" if version == 2 else "Functional"
    start, *last = ([name, 0, 0] for name in (names[0], *names[-ends:]))
    config["config"]["input_layers"] = [start] if version == 2 else start
    config["config"]["output_layers"] = last if version == 2 or ends > 1 else last[0]
    entries.reverse()
    return config


def write_groups(group: h5py.Group, layers: list[Layer], version: int, backend: str) -> None:
    """Write weights in the legacy layout, one group for each layer."""
    group.attrs["keras_version"] = {1: b"1.2.2", 2: b"2.0.8", 3: b"3.5.0"}[version]
    group.attrs["backend"] = backend.encode()
    group.attrs["layer_names"] = [name.encode() for name, *_ in named_layers(layers)]
    for name, kind, config, weights in named_layers(layers):
        ends = [*ENDS.get(kind, USUAL)]
        if kind == "BatchNormalization":
            switches = {"gamma": "scale", "beta": "center"}
            ends = [end for end in ends if config.get(switches.get(end, ""), True)]
        subgroup = group.create_group(name)
        names = [
            f"{name}_{KERAS_1.get(end, end)}" if version == 1 else f"{name}/{end}:0"
            for end, _ in zip(ends, weights, strict=False)
        ]
        subgroup.attrs["weight_names"] = [key.encode() for key in names]
        for key, array in zip(names, weights, strict=True):
            subgroup.create_dataset(key, data=array)


def write_h5(
    path: Path,
    layers: list[Layer],
    version: int = 2,
    shape: tuple | None = INPUT,
    backend: str = "tensorflow",
    config: dict | None = None,
) -> Path:
    """Write a whole model as Keras 1 or 2 does, or Keras 3 for a `.h5`."""
    with h5py.File(path, "w") as file:
        config = config or model_config(layers, shape, version)
        file.attrs["model_config"] = json.dumps(config).encode()
        write_groups(file.create_group("model_weights"), layers, version, backend)
    return path


def write_json(path: Path, layers: list[Layer], shape: tuple | None = INPUT) -> Path:
    """Write `model.json` and the weights alone with the same stem, as Keras 2 does."""
    config = model_config(layers, shape) | {"keras_version": "2.0.8", "backend": "tensorflow"}
    path.write_text(json.dumps(config))
    with h5py.File(path.with_suffix(".h5"), "w") as file:
        write_groups(file, layers, 2, "tensorflow")
    return path


def keras_3_weights(layers: list[Layer]) -> bytes:
    """Return the bytes of Keras 3's `model.weights.h5`."""
    buffer = io.BytesIO()
    counts: dict[str, int] = {}
    with h5py.File(buffer, "w") as file:
        for kind, _, weights in layers:
            names = {"PReLU": "p_re_lu", "BatchNormalization": "batch_normalization"}
            key = names.get(kind, kind.lower().replace("separable", "separable_"))
            counts[key] = counts.get(key, 0) + 1
            if counts[key] > 1:
                key = f"{key}_{counts[key] - 1}"
            group = file.create_group(f"layers/{key}/vars")
            for number, array in enumerate(weights):
                group.create_dataset(str(number), data=array)
    return buffer.getvalue()


def write_keras(
    path: Path, layers: list[Layer], shape: tuple | None = INPUT, config: dict | None = None
) -> Path:
    """Write a `.keras` file of Keras 3."""
    config = config or model_config(layers, shape, 3)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata.json", json.dumps({"keras_version": "3.5.0"}))
        archive.writestr("config.json", json.dumps(config))
        archive.writestr("model.weights.h5", keras_3_weights(layers))
    return path


def write_any(path: Path, layers: list[Layer]) -> Path:
    """Write a model in the format of the path's suffix."""
    writers = {".h5": write_h5, ".json": write_json, ".keras": write_keras}
    return writers[path.suffix](path, layers)


def lambda_config(function: FunctionType, style: str = "base64") -> dict:
    """Return a Lambda's config; the function is marshalled by this Python, and never called.

    Args:
        function: the Lambda's function.
        style: `base64` (Keras 2.1 and later), `escape` (earlier) or `keras3`.
    """
    data = marshal.dumps(function.__code__)
    text = base64.encodebytes(data).decode()
    if style == "keras3":
        config = {"code": text, "defaults": None, "closure": None}
        return {"function": {"class_name": "__lambda__", "config": config}}
    text = data.decode("raw_unicode_escape") if style == "escape" else text
    return {"function": [text, None, None], "function_type": "lambda"}
