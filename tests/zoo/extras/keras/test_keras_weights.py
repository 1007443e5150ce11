"""Old Keras files, written here layer by layer and computed in Keras' own order of axes."""

import functools
import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from datamodules.view import View
from tests.refusals import refusal
from tests.zoo.extras.keras import keras_reference
from tests.zoo.extras.keras.keras_files import (
    Layer,
    model_config,
    random_weights,
    write_groups,
    write_h5,
)
from tests.zoo.extras.keras.test_keras_layers import outputs
from tests.zoo.models import test_models_command
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.models.make_network import make_network
from zoo.training.initial_weights import load_weights

# Kernels as Keras keeps them: (h, w, in, out), (columns, in, out) and (in, out).
KERNELS = {
    "nvidia": [(5, 5, 3, 24), (5, 5, 24, 36), (5, 5, 36, 48), (3, 3, 48, 64), (3, 3, 64, 64),
               (1152, 100), (100, 50), (50, 10), (10, 1)],
    "lenet": [(5, 5, 1, 6), (5, 5, 6, 16), (1040, 120), (120, 84), (84, 1)],
    "commaai": [(8, 8, 3, 16), (5, 5, 16, 32), (5, 5, 32, 64), (12800, 512), (512, 1)],
    "tiny": [(1, 11, 2), (16, 1)],
    "tiny63": [(3, 3, 1, 2), (42, 1)],
}  # fmt: skip
build = functools.cache(test_models_command.build)  # each test loads its own weights
ELU, RELU, SAME = {"activation": "elu"}, {"activation": "relu"}, {"padding": "same"}
TWO, FOUR = {"strides": (2, 2)}, {"strides": (4, 4)}
FLATTEN, POOL = ("Flatten", {}), ("MaxPooling2D", {})
# The layers of each network in Keras; those of the kernels take their weights in turn.
NETWORKS: dict[str, list[tuple[str, dict]]] = {
    "nvidia": [*[("Conv2D", ELU | TWO)] * 3, *[("Conv2D", ELU)] * 2, FLATTEN,
               *[("Dense", ELU)] * 3, ("Dense", {})],
    "lenet": [("Conv2D", RELU), POOL, ("Conv2D", RELU), POOL, FLATTEN,
              *[("Dense", RELU)] * 2, ("Dense", {})],
    "commaai": [("Conv2D", ELU | FOUR | SAME), ("Conv2D", ELU | TWO | SAME),
                ("Conv2D", TWO | SAME), FLATTEN, ("ELU", {}), ("Dense", ELU), ("Dense", {})],
    "tiny": [("Permute", {"dims": (3, 2, 1)}), ("Conv2D", RELU),
             ("MaxPooling2D", {"pool_size": (1, 4)}), FLATTEN, ("Dense", {})],
    "tiny63": [("Conv2D", RELU), ("MaxPooling2D", {"pool_size": (4, 4)}), FLATTEN, ("Dense", {})],
}  # fmt: skip


def random_layers(kernels: list[tuple[int, ...]]) -> list[list[np.ndarray]]:
    return [random_weights(shape, shape[-1:], seed=seed) for seed, shape in enumerate(kernels)]


def write_keras(
    path: Path,
    arrays: list,
    version: int = 2,
    whole_model: bool = True,
    config: dict | None = None,
    pieces: bool = False,
    backend: str = "tensorflow",
) -> Path:
    """Write a file in the layout of Keras 1 or 2, with layers without weights around.

    `config` has settings of the `first` layer, each `convolution`, and `flatten`.
    """
    settings = config or {}
    layers: list[Layer] = [("Lambda", settings.get("first", {}), [])]
    for kernel, bias in arrays:
        is_dense = kernel.ndim == 2
        kind, entry = ("Dense", {}) if is_dense else ("Convolution2D", settings.get("convolution"))
        layers.append((kind, entry or {}, [kernel, bias]))
    layers.append(("Flatten", settings.get("flatten", {}), []))
    with h5py.File(path, "w") as file:
        group = file.create_group("model_weights") if whole_model else file
        write_groups(group, layers, version, backend)
        if pieces:
            names = group.attrs["layer_names"]
            del group.attrs["layer_names"]
            group.attrs["layer_names0"], group.attrs["layer_names1"] = names[:2], names[2:]
        if config is not None:
            file.attrs["model_config"] = json.dumps(model_config(layers, None, 1)).encode()
    return path


def keras_predict(name: str, pictures: np.ndarray, arrays: list) -> np.ndarray:
    """Return a Keras model's outputs for uint8 [N, H, W, C], computed without our code."""
    pairs, layers = iter(arrays), []
    for kind, config in NETWORKS[name]:
        weights = list(next(pairs)) if kind in ("Conv2D", "Dense") else []
        if weights and weights[0].ndim == 3:  # of a 1-D convolution
            weights[0] = weights[0][None]
        layers.append((kind, config, weights))
    return keras_reference.predict(pictures / 127.5 - 1, layers)


def predictions(name: str, path: Path, layers: list) -> tuple[np.ndarray, np.ndarray]:
    network, view = build(name)
    load_weights(network, str(path))
    pictures = np.random.default_rng(1).integers(0, 256, (2, *view.shape), dtype=np.uint8)
    return outputs(network, pictures), keras_predict(name, pictures, layers)


@pytest.mark.parametrize("version", [pytest.param(1, marks=pytest.mark.slow), 2])
@pytest.mark.parametrize("name", list(KERNELS))
def test_an_old_model_predicts_what_it_did(name: str, version: int, tmp_path: Path) -> None:
    layers = random_layers(KERNELS[name])
    ours, theirs = predictions(name, write_keras(tmp_path / "m.h5", layers, version), layers)
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-4)


def channels_first(layers: list) -> list:
    """Return LeNet's layers as channels-first Keras 1 saves them: kernels (out, in, h, w)."""
    stored = [(k.transpose(3, 2, 0, 1) if k.ndim == 4 else k, b) for k, b in layers]
    kernel, bias = stored[2]
    by_channel = kernel.reshape(5, 13, 16, -1).transpose(2, 0, 1, 3).reshape(kernel.shape)
    return [*stored[:2], (by_channel, bias), *stored[3:]]


def turned(layers: list) -> list:
    """Return kernels (h, w, in, out) as Theano saves them: mirrored, since it convolves."""
    return [(k[::-1, ::-1] if k.ndim == 4 else k, b) for k, b in layers]


FIRST = {"data_format": "channels_first"}
LAYOUTS: dict[str, tuple[Callable[[list], list], dict]] = {
    "weights alone, long lists of names": (list, {"whole_model": False, "pieces": True}),
    "channels first in Keras 1": (
        channels_first,
        {"version": 1, "config": {"convolution": {"dim_ordering": "th"}}},
    ),
    # A file of weights alone shows the order only by its kernels' shapes.
    "channels first, weights alone": (channels_first, {"version": 1, "whole_model": False}),
    # Keras' Flatten puts the channels last from 2.2 on in channels-first models, for the weights.
    "channels first from Keras 2.2 on": (
        list,
        {"config": {"convolution": FIRST, "flatten": FIRST}},
    ),
    # Kernels are (h, w, in, out), but the flatten order is torch's.
    "channels first before Keras 2.2": (
        lambda layers: [*layers[:2], channels_first(layers)[2], *layers[3:]],
        {"config": {"convolution": FIRST}},
    ),
    "Theano in Keras 1": (turned, {"version": 1, "backend": "theano"}),
    "Theano in Keras 2": (turned, {"backend": "theano"}),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_model_of_another_layout_predicts_what_it_did(name: str, tmp_path: Path) -> None:
    layers = random_layers(KERNELS["lenet"])
    stored, settings = LAYOUTS[name]
    path = write_keras(tmp_path / "model.h5", stored(layers), **settings)
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-4, atol=1e-4)


def test_a_file_that_does_not_name_its_backend_is_taken_for_tensorflows(tmp_path: Path) -> None:
    stored = channels_first(random_layers(KERNELS["lenet"]))
    path = write_keras(tmp_path / "model.h5", stored, version=1, backend="")
    assert "no backend in the file" in load_weights(build("lenet")[0], str(path))


@pytest.mark.parametrize("shape", [(1, 1, 11, 2), (2, 11, 1, 1)], ids=["2-D or 1.2", "1.0"])
def test_other_layouts_of_a_1_x_1_convolution_fit_tiny(shape: tuple, tmp_path: Path) -> None:
    """The kernel of a Conv2D or of Keras 1.2, and of Keras 1.0."""
    layers = random_layers(KERNELS["tiny"])
    kernel, bias = layers[0]
    stored = (kernel.transpose(2, 1, 0) if shape[0] == 2 else kernel).reshape(shape)
    path = write_keras(tmp_path / "m.h5", [(stored, bias), layers[1]], version=1)
    np.testing.assert_allclose(*predictions("tiny", path, layers), rtol=1e-4, atol=1e-4)


def test_the_layer_that_differs_is_named_with_what_to_set(tmp_path: Path) -> None:
    kernels = [*KERNELS["nvidia"]]
    kernels[5] = (8448, 100)
    config = {"first": {"batch_input_shape": [None, 160, 320, 3], "cropping": [[50, 20], [0, 0]]}}
    path = write_keras(tmp_path / "model.h5", random_layers(kernels), config=config)
    network, _ = build("nvidia")
    before = [parameter.clone() for parameter in network.parameters()]
    message = refusal(load_weights, network, str(path))
    assert f"{path}: layer 6 of 9, dense_1, does not fit PilotNet: " in message
    assert "kernel is 8448 x 100 in the file, 1152 x 100" in message
    assert "set model.size and data.crop" in message
    assert "its input is 160 x 320 x 3" in message
    assert all(torch.equal(a, b) for a, b in zip(before, network.parameters(), strict=True))
    model = compose_config(["model=nvidia", "model.size=null"])["model"]
    load_weights(make_network(model, View([50, 20], model["colour"], None)), str(path))


@pytest.mark.parametrize(
    ("name", "layer", "shape", "words"),
    [
        ("lenet", 0, (5, 5, 3, 6), "set model.colour"),
        ("lenet", 1, (5, 5, 6, 32), "set model.width"),
        ("tiny", 0, (1, 16, 2), "set model.size and data.crop"),
    ],
)
def test_what_to_set_follows_from_the_layer(
    name: str, layer: int, shape: tuple, words: str, tmp_path: Path
) -> None:
    kernels = [*KERNELS[name]]
    kernels[layer] = shape
    path = write_keras(tmp_path / "model.h5", random_layers(kernels))
    with pytest.raises(InputError, match=f"layer {layer + 1} of {len(kernels)}, .*{words}"):
        load_weights(build(name)[0], str(path))


@pytest.mark.parametrize(
    ("activation", "divisor", "words"),
    [
        ("relu", 127.5, ""),
        ("relu", None, "the scale of its pixels is unknown"),
        ("tanh", 127.5, "scale (127.5, 1.0)"),
        ("relu", 255, "scale (255.0, 1.0)"),
    ],
)
def test_a_file_that_computes_otherwise_is_named(
    activation: str, divisor: float | None, words: str, tmp_path: Path
) -> None:
    arrays = iter(random_layers(KERNELS["lenet"]))
    scale = {"scale": 1 / (divisor or 1), "offset": -1}
    layers: list[Layer] = [("Rescaling", scale, [])] if divisor else []
    for kind, config in NETWORKS["lenet"]:
        config = {"activation": activation} if config == RELU else config
        weights = list(next(arrays)) if kind in ("Conv2D", "Dense") else []
        sizes = {"filters": len(weights[-1]), "kernel_size": [5, 5]} if kind == "Conv2D" else {}
        sizes = {"units": len(weights[-1])} if kind == "Dense" else sizes
        layers.append((kind, config | sizes, weights))
    path = write_h5(tmp_path / "model.h5", layers, shape=(32, 64, 1))
    printed = load_weights(build("lenet")[0], str(path))
    assert words in printed
    assert ("steer otherwise" in printed) == bool(words and divisor)
    assert ("is unknown" in printed) == (divisor is None)


def test_another_networks_file_is_refused(tmp_path: Path) -> None:
    path = write_keras(tmp_path / "model.h5", random_layers(KERNELS["lenet"]))
    with pytest.raises(InputError, match=r"has 5 layers with weights .* PilotNet has 9"):
        load_weights(build("nvidia")[0], str(path))


@pytest.mark.parametrize("dtype", [">f4", "f8", "f2"])
def test_floats_of_any_kind_load(dtype: str, tmp_path: Path) -> None:
    layers = random_layers(KERNELS["lenet"])
    stored = [(kernel.astype(dtype), bias.astype(dtype)) for kernel, bias in layers]
    path = write_keras(tmp_path / "model.h5", stored)
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-2, atol=1e-2)


def test_arrays_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    layers = random_layers(KERNELS["lenet"])
    path = write_keras(tmp_path / "model.h5", [(layers[0][0].astype("S8"), layers[0][1])])
    assert "does not hold numbers; save" in refusal(load_weights, build("lenet")[0], str(path))
