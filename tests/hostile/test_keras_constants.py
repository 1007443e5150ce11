"""Keras files whose constants are too many, too large or no numbers: one line each."""

import math
import struct
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.hostile.crafted_files import lambda_with, shared_constants
from tests.zoo.keras.keras_files import Layer, random_weights, write_h5
from zoo.base.errors import InputError
from zoo.keras.keras_file import read_keras
from zoo.keras.keras_lambda import describe_lambda, specs_of_word
from zoo.keras.keras_layers import convert
from zoo.models.layer_spec import LayerSpec

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


@pytest.mark.parametrize("word", ["scale:nan:1", "scale:1e-320:1", "atan:inf", "scale:1:1e300"])
def test_a_users_word_has_ordinary_numbers(word: str) -> None:
    assert specs_of_word(word) is None


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


def test_a_specs_number_of_400_digits_is_named() -> None:
    with pytest.raises(ValueError, match=r"layer 1: alpha="):
        LayerSpec({"layer": "ELU", "alpha": 10**400}, "layer 1").number("alpha")


def test_one_value_in_a_huge_compressed_chunk_is_not_unpacked(tmp_path: Path) -> None:
    path = write_h5(tmp_path / "m.h5", REST)
    with h5py.File(path, "r+") as file:
        group = file["model_weights/dense_1/dense_1"]
        del group["bias:0"]
        more = {"chunks": (1_000_000_000,), "maxshape": (None,), "compression": "gzip"}
        group.create_dataset("bias:0", (1,), "f4", **more)
    with pytest.raises(InputError, match=r"m\.h5: dense_1/bias:0 is compressed"):
        read_keras(path)


def test_one_value_in_a_huge_chunk_is_not_read(tmp_path: Path) -> None:
    path = write_h5(tmp_path / "m.h5", REST)
    with h5py.File(path, "r+") as file:
        group = file["model_weights/dense_1/dense_1"]
        del group["bias:0"]
        group.create_dataset("bias:0", (1,), "f4", chunks=(1_000_000_000,), maxshape=(None,))
    with pytest.raises(InputError, match=r"m\.h5: dense_1/bias:0: claims 4,000,007,200 bytes"):
        read_keras(path)
