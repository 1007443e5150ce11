"""Write layers as Keras 3's `.keras`, a zip of JSON and HDF5, without Keras."""

import io
import json
import re
import zipfile
from collections import Counter
from typing import Any

import cv2
import numpy as np

from datamodules.view import RESIZES, View
from zoo.base.errors import InputError

Layer = tuple[str, dict[str, Any], list[np.ndarray]]  # class, config, kernel and bias
VERSION = "3.0.0"  # of Keras; the first that reads this format


def zip_bytes(layers: list[Layer], ends: int, shape: tuple[int, ...]) -> bytes:
    """Return a `.keras` file whose last `ends` layers all take the output of the layer before them.

    Weights stand under the layers' classes and numbers (`saving/saving_lib.py`).
    """
    import h5py  # optional, checked before

    start = {"name": "img_in", "batch_shape": [None, *shape], "dtype": "float32"}
    entries, weights_file, counts = [_entry("InputLayer", start, [])], io.BytesIO(), Counter[str]()
    with h5py.File(weights_file, "w") as file:
        file.create_group("vars")  # of the model itself; Keras 3.4 wants it
        for number, (kind, config, weights) in enumerate(layers):
            key = re.sub("([a-z])([A-Z])", r"\1_\2", kind).lower()
            before = entries[min(number, len(layers) - ends)]["name"]
            tensor = {"shape": [None], "dtype": "float32", "keras_history": [before, 0, 0]}
            inputs = {"class_name": "__keras_tensor__", "config": tensor}
            named = {"name": f"{key}_{number}", "dtype": "float32"} | config
            entries.append(_entry(kind, named, [{"args": [inputs], "kwargs": {}}]))
            group = f"layers/{key}_{counts[key]}" if counts[key] else f"layers/{key}"
            counts[key] += 1
            for place, array in enumerate(weights):
                file.create_dataset(f"{group}/vars/{place}", data=array.astype(np.float32))
    outputs = [[entry["name"], 0, 0] for entry in entries[-ends:]]
    model = {"name": "drivezoo", "trainable": True, "layers": entries}
    model |= {"input_layers": [["img_in", 0, 0]], "output_layers": outputs}
    config = {"module": "keras.src.models.functional", "class_name": "Functional"}
    contents = io.BytesIO()
    with zipfile.ZipFile(contents, "w") as archive:
        archive.writestr("metadata.json", json.dumps({"keras_version": VERSION}))
        archive.writestr("config.json", json.dumps(config | {"config": model}))
        archive.writestr("model.weights.h5", weights_file.getvalue())
    return contents.getvalue()


def resizing_layers(view: View) -> list[Layer]:
    """Return layers that resize a cropped frame as OpenCV does.

    Keras 3 has no `area`. Resizing is linear and separable: a dense layer along each axis.
    """
    way = view.resize.removesuffix("_first")
    rows, columns = view.frame[0] - sum(view.rows_cropped(view.frame[0])), view.frame[1]
    height, width = view.size or (rows, columns)
    grows = way == "area" and (height > rows or width > columns)  # which OpenCV does otherwise
    if way not in ("area", "linear") or grows:
        raise InputError(
            f"resize={view.resize} of {rows} x {columns} to {height} x {width}: Keras 3 has no "
            "layer for it; train with model.resize=linear"
        )
    layers: list[Layer] = [("Permute", {"dims": [1, 3, 2]}, [])]
    for before, after, order in ((columns, width, [3, 2, 1]), (rows, height, [3, 1, 2])):
        identity = np.eye(before, dtype=np.float32)
        kernel = cv2.resize(identity, (after, before), interpolation=RESIZES[way])
        layers.append(("Dense", {"units": after, "use_bias": False}, [kernel]))
        layers.append(("Permute", {"dims": order}, []))
    return layers


def _entry(kind: str, config: dict[str, Any], inputs: list[Any]) -> dict[str, Any]:
    return {
        "module": "keras.layers",
        "class_name": kind,
        "config": config,
        "registered_name": None,
        "name": config["name"],
        "inbound_nodes": inputs,
    }
