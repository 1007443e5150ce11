"""Damaged files of Keras: each is read, or refused in one line that names it."""

import io
import math
import os
import struct
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from hypothesis import strategies as st

from tests.hostile.crafted_files import contents_of, lambda_with, shared_constants
from tests.hostile.mutations import (
    FEW_AND_MANY,
    mutated_bytes,
    mutated_json,
    mutated_zip,
    read_damaged,
)
from tests.hostile.test_damaged_networks import KIND_BEGINS
from tests.zoo.extras.keras.keras_files import (
    Layer,
    keras_3_weights,
    lambda_config,
    model_config,
    random_weights,
    write_h5,
    write_json,
    write_keras,
)
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.extras.keras.keras_file import check_kind, read_keras
from zoo.extras.keras.keras_lambda import describe_lambda
from zoo.extras.keras.keras_layers import convert

KERAS: list[Layer] = [
    ("Lambda", lambda_config(lambda x: x / 127.5 - 1.0), []),
    ("Conv2D", {"filters": 2, "kernel_size": [3, 3]}, random_weights((3, 3, 3, 2), (2,))),
    ("BatchNormalization", {"axis": -1, "epsilon": 0.001}, random_weights(*[(2,)] * 4)),
    ("Flatten", {}, []),
    ("Dense", {"units": 1}, random_weights((1008, 1), (1,))),
]


# Layers with most settings, before those of `KERAS` but the scale.
SET: list[Layer] = [
    ("Resizing", {"height": 20, "width": 30, "interpolation": "nearest"}, []),
    KERAS[0],
    ("ZeroPadding2D", {"padding": [[1, 0], [0, 1]]}, []),
    ("ReLU", {"max_value": 1.0, "negative_slope": 0.1, "threshold": 0.1}, []),
    ("MaxPooling2D", {"pool_size": [2, 2], "strides": [1, 1], "padding": "same"}, []),
    ("Cropping2D", {"cropping": [[1, 0], [0, 1]]}, []),
    ("Dropout", {"rate": 0.1}, []),
    ("Reshape", {"target_shape": [20, 30, 3]}, []),
    *KERAS[1:],
]


def imported(path: Path) -> None:
    convert(read_keras(path))


@FEW_AND_MANY
def test_a_damaged_keras_architecture_is_named(count: int, tmp_path: Path) -> None:
    path = write_json(tmp_path / "m.json", SET)
    imported(path)
    read_damaged(mutated_json(model_config(SET)), imported, path, count)


@FEW_AND_MANY
def test_a_damaged_keras_archive_is_named(count: int, tmp_path: Path) -> None:
    path = write_keras(tmp_path / "m.keras", KERAS)
    # Bytes of HDF5 are not damaged here: its library never returns from some such files.
    weights = keras_3_weights(KERAS)
    members = {
        "config.json": mutated_json(model_config(KERAS, version=3)),
        ".h5": st.integers(0, len(weights)).map(lambda end: weights[:end]),
    }
    read_damaged(mutated_zip(path.read_bytes(), members), imported, path, count)


ODD_ATTRIBUTES = (
    True, 0, 2**40, math.nan, "", "x", b"\xff", np.zeros(0), np.array([b"a", b"b"]), np.eye(2),
    h5py.Empty("f"),
)  # fmt: skip


ODD_DATA = (
    1.0, "text", h5py.Empty("f"), np.zeros(0), np.zeros((3, 3, 3, 3, 3)), np.zeros(2, np.complex64),
    np.full((1008, 1), np.nan), np.array([b"abc"]), np.zeros((2, 3), bool),
)  # fmt: skip


@st.composite
def mutated_hdf5(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw an HDF5 file with lost, renamed or odd groups, arrays and attributes."""
    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        for _ in range(draw(st.integers(1, 3))):
            items: list = [file]
            file.visititems(lambda _, item, items=items: items.append(item))
            if draw(st.booleans()) and (holders := [item for item in items if len(item.attrs)]):
                attributes = draw(st.sampled_from(holders)).attrs
                key = draw(st.sampled_from(sorted(attributes)))
                del attributes[key]
                if draw(st.booleans()):
                    attributes[key] = draw(st.sampled_from(ODD_ATTRIBUTES))
            elif len(items) > 1:
                path = draw(st.sampled_from([item.name for item in items[1:]]))
                how = draw(st.sampled_from(("lose", "move", "group", "data", "data")))
                target = f"{path}x" if how == "move" else path
                if how == "move":
                    file.move(path, target)
                else:
                    del file[path]
                if how == "group":
                    file.create_group(path)
                elif how == "data":
                    file[path] = draw(st.sampled_from(ODD_DATA))
    return buffer.getvalue()


@FEW_AND_MANY
@pytest.mark.parametrize("name", ["whole", "weights", "packed"])
def test_a_damaged_hdf5_file_is_named(name: str, count: int, tmp_path: Path) -> None:
    whole = write_h5(tmp_path / "m.h5", KERAS).read_bytes()
    damaged, path = mutated_hdf5(whole), tmp_path / "m.h5"
    if name == "weights":
        write_json(tmp_path / "m.json", KERAS)
        damaged = mutated_hdf5(path.read_bytes())
    elif name == "packed":
        path = tmp_path / "m.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("course/m.h5", whole)
        packed = path.read_bytes()
        damaged = mutated_zip(packed, {".h5": damaged}) | mutated_bytes(packed)
    read_damaged(damaged, imported, path, count)


REST: list[Layer] = [("Flatten", {}, []), ("Dense", {"units": 1}, random_weights((1800, 1), (1,)))]


def digits(count: int) -> bytes:
    return b"l" + struct.pack("<i", count) + b"\xff\x7f" * count


def number(value: float) -> bytes:
    return b"g" + struct.pack("<d", value)


ODD_CONSTANTS = {
    "shared": shared_constants(40),
    "200 digits": digits(200),
    "million digits": digits(1_000_000),
    "NaN": number(math.nan),
    "infinite": number(math.inf),
    "1e-320": number(1e-320),
    "1e300": number(1e300),
}


@pytest.mark.parametrize("name", ODD_CONSTANTS)
def test_a_lambdas_odd_constant_makes_it_unclear(name: str, tmp_path: Path) -> None:
    layers = [("Lambda", lambda_with(ODD_CONSTANTS[name]), []), *REST]
    with pytest.raises(InputError, match=r"layer 1 of 3, lambda_1 .*lambdas=\[WORD\]"):
        convert(read_keras(write_h5(tmp_path / "m.h5", layers)))


def test_a_lambdas_ordinary_constants_are_read() -> None:
    assert describe_lambda(lambda_with(number(0.5)))[0] == "scale:2:-0"
    assert describe_lambda(lambda_with(digits(11)))[0] is None


SCALES = {
    "NaN": ("Rescaling", {"scale": math.nan}),
    "infinite": ("Rescaling", {"scale": math.inf, "offset": 0.0}),
    "1e-320": ("Rescaling", {"scale": 1e-320, "offset": 0.0}),
    "offset's digits": ("Rescaling", {"scale": 1.0, "offset": 10**400}),
    "scale's digits": ("Rescaling", {"scale": 10**400, "offset": 1}),
    "list": ("Rescaling", {"scale": [10**400, 1, 1], "offset": 1}),
    "mean's digits": ("Normalization", {"mean": [10**400], "variance": [1.0]}),
    "mean's NaN": ("Normalization", {"mean": [math.nan], "variance": [1.0]}),
    "variance's digits": ("Normalization", {"mean": [1.0], "variance": [10**400]}),
    "epsilon's digits": ("BatchNormalization", {"epsilon": 10**400}),
}


@pytest.mark.parametrize("name", SCALES)
def test_a_layers_odd_constant_is_named(name: str, tmp_path: Path) -> None:
    kind, config = SCALES[name]
    arrays = [np.ones(3, np.float32)] * 4 if kind == "BatchNormalization" else []
    path = write_h5(tmp_path / "m.h5", [(kind, config, arrays), *REST])
    with pytest.raises(InputError, match=r"m\.h5: .*layer 1 of 3") as caught:
        convert(read_keras(path))
    assert len(str(caught.value)) < 500 + len(str(path))


def test_many_small_scales_do_not_become_infinite(tmp_path: Path) -> None:
    layers: list[Layer] = [("Rescaling", {"scale": 1e-8, "offset": 0.0}, [])] * 50
    with pytest.raises(InputError, match=r"m\.h5: layer 2 of 52"):
        convert(read_keras(write_h5(tmp_path / "m.h5", [*layers, *REST])))


def test_an_operators_constant_of_400_digits_is_named(tmp_path: Path) -> None:
    config = {"name": "t", "function": "math.truediv"}
    entry = {"class_name": "TFOpLambda", "config": config, "name": "t"}
    layers = [{"class_name": "InputLayer", "config": {"name": "i"}, "inbound_nodes": []}]
    layers += [entry | {"inbound_nodes": [["i", 0, 0, {"y": 10**400}]]}]
    model = {"class_name": "Functional", "config": {"name": "f", "layers": layers}}
    with pytest.raises(InputError, match=r"m\.h5: layer 2 of 2, t "):
        convert(read_keras(write_h5(tmp_path / "m.h5", REST, config=model)), size=(20, 30))


HUGE_CHUNK = {"chunks": (1_000_000_000,), "maxshape": (None,)}


@pytest.mark.parametrize(
    ("name", "shape", "how", "words"),
    [
        ("kernel:0", (10**6, 10**6), {"chunks": (1000, 1000)}, ": claims 4,000,000,000,000 bytes"),
        ("bias:0", (1,), HUGE_CHUNK | {"compression": "gzip"}, " is compressed"),
        ("bias:0", (1,), HUGE_CHUNK, ": claims 4,000,007,200 bytes"),
    ],
    ids=["large array", "compressed chunk", "large chunk"],
)
def test_an_array_that_claims_more_than_the_file_holds_is_not_read(
    name: str, shape: tuple[int, ...], how: dict, words: str, tmp_path: Path
) -> None:
    path = write_h5(tmp_path / "m.h5", REST)
    with h5py.File(path, "r+") as file:
        group = file["model_weights/dense_1/dense_1"]
        del group[name]
        group.create_dataset(name, shape, "f4", **how)
    with pytest.raises(InputError, match=rf"m\.h5: dense_1/{name}{words}"):
        read_keras(path)


def test_a_network_larger_than_its_weights_is_not_built(tmp_path: Path) -> None:
    path = write_constant(tmp_path / "x.ckpt", 0.1)
    contents = contents_of(path)
    layers = [{"layer": "Flatten"}, {"layer": "Dense", "units": 9_000_000}]
    model = {"_target_": "zoo.extras.keras.sequential.Sequential", "layers": layers}
    contents["drivezoo"]["config"]["model"] |= model
    torch.save(contents, path)
    with pytest.raises(InputError, match=r"x\.ckpt: .*126,000,000 parameters"):
        load_checkpoint(path)


@FEW_AND_MANY
@pytest.mark.parametrize("suffix", [".h5", ".keras", ".json", ".ckpt"])
def test_a_damaged_file_of_another_kind_is_named(suffix: str, count: int, tmp_path: Path) -> None:
    damaged = st.sampled_from((*KIND_BEGINS, b"", b"no model")).flatmap(mutated_bytes)
    for read in (imported, check_kind):
        read_damaged(damaged, read, tmp_path / f"x{suffix}", count // 3)


def test_only_regular_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.h5")
    with pytest.raises(InputError, match=r"x\.h5: .*no regular file"):
        read_keras(tmp_path / "x.h5")
