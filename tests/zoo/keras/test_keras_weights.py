"""Old Keras files, written here layer by layer and computed in Keras' own order of axes."""

import json
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from datamodules.view import View
from tests.zoo.models.test_models_command import build
from zoo.base.errors import InputError
from zoo.cli.compose import compose_config
from zoo.keras.initial_weights import load_weights
from zoo.keras.keras_file import read_keras
from zoo.models.make_network import make_network

# Kernels as Keras keeps them: (h, w, in, out), (columns, in, out) and (in, out).
KERNELS = {
    "nvidia": [(5, 5, 3, 24), (5, 5, 24, 36), (5, 5, 36, 48), (3, 3, 48, 64), (3, 3, 64, 64),
               (1152, 100), (100, 50), (50, 10), (10, 1)],
    "lenet": [(5, 5, 1, 6), (5, 5, 6, 16), (1040, 120), (120, 84), (84, 1)],
    "commaai": [(8, 8, 3, 16), (5, 5, 16, 32), (5, 5, 32, 64), (12800, 512), (512, 1)],
    "tiny": [(1, 11, 2), (16, 1)],
    "tiny63": [(3, 3, 1, 2), (42, 1)],
}  # fmt: skip
STRIDES = {"nvidia": [2, 2, 2, 1, 1], "lenet": [1, 1], "commaai": [4, 2, 2], "tiny63": [1]}


def random_layers(kernels: list[tuple[int, ...]]) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(0)
    return [
        (
            (rng.normal(size=shape) / np.sqrt(np.prod(shape[:-1]))).astype(np.float32),
            rng.normal(size=shape[-1]).astype(np.float32) * 0.1,
        )
        for shape in kernels
    ]


def write_keras(
    path: Path,
    layers: list[tuple[np.ndarray, np.ndarray]],
    version: int = 2,
    whole_model: bool = True,
    config: dict | None = None,
    pieces: bool = False,
    backend: bytes = b"tensorflow",
) -> Path:
    """Write a file in the layout of Keras 1 or 2, with a layer without weights in between.

    `config` has settings of the `first` layer, each `convolution`, and `flatten`.
    """
    with h5py.File(path, "w") as file:
        group = file.create_group("model_weights") if whole_model else file
        group.attrs["keras_version"] = {1: b"1.2.2", 2: b"2.0.6"}[version]
        group.attrs["backend"] = backend
        names = [f"{'convolution2d' if k.ndim > 2 else 'dense'}_{i}" for i, (k, _) in
                 enumerate(layers, start=1)]  # fmt: skip
        all_names = [b"lambda_1", *(name.encode() for name in names)]
        if pieces:
            group.attrs["layer_names0"], group.attrs["layer_names1"] = all_names[:2], all_names[2:]
        else:
            group.attrs["layer_names"] = all_names
        group.create_group("lambda_1").attrs["weight_names"] = np.array([], dtype="S1")
        for name, arrays in zip(names, layers, strict=True):
            layer = group.create_group(name)
            ends = ("_W", "_b") if version == 1 else ("/kernel:0", "/bias:0")
            layer.attrs["weight_names"] = [f"{name}{end}".encode() for end in ends]
            for end, array in zip(ends, arrays, strict=True):
                layer.create_dataset(f"{name}{end}", data=array)
        if config is not None:
            model = [
                {"class_name": "Lambda", "config": {"name": "lambda_1"} | config.get("first", {})}
            ]
            for name, (kernel, _) in zip(names, layers, strict=True):
                kind, own = (
                    ("Convolution2D", "convolution") if kernel.ndim > 2 else ("Dense", "dense")
                )
                settings = {"name": name} | config.get(own, {})
                model.append({"class_name": kind, "config": settings})
            model.append({"class_name": "Flatten", "config": config.get("flatten", {})})
            whole = {"class_name": "Sequential", "config": model}
            file.attrs["model_config"] = json.dumps(whole).encode()
    return path


def keras_convolve(x: np.ndarray, kernel: np.ndarray, bias: np.ndarray, stride: int, same: bool):
    """Convolve x [N, H, W, C] as a sum of products over windows."""
    if same:
        pads = [(0, 0)]
        for size, k in zip(x.shape[1:3], kernel.shape[:2], strict=True):
            total = max((-(-size // stride) - 1) * stride + k - size, 0)
            pads.append((total // 2, total - total // 2))
        x = np.pad(x, [*pads, (0, 0)])
    windows = np.lib.stride_tricks.sliding_window_view(x, kernel.shape[:2], axis=(1, 2))
    windows = windows[:, ::stride, ::stride]
    return np.einsum("nhwcij,ijco->nhwo", windows, kernel, optimize=True) + bias


def pool(x: np.ndarray, size: int) -> np.ndarray:
    n, h, w, c = x.shape
    x = x[:, : h // size * size, : w // size * size]
    return x.reshape(n, h // size, size, w // size, size, c).max(axis=(2, 4))


def elu(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0)))


def relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0)


def keras_predict(name: str, pictures: np.ndarray, layers: list) -> np.ndarray:
    """Return a Keras model's outputs for uint8 [N, H, W, C], computed without our code."""
    x = pictures.astype(np.float64) / 127.5 - 1
    activation = relu if name in ("lenet", "tiny", "tiny63") else elu
    layers = list(layers)
    if name == "tiny":
        kernel, bias = layers.pop(0)
        x = relu(np.einsum("nrc,ro->nco", x[..., 0], kernel[0]) + bias)  # [N, columns, 2]
        x = x.reshape(len(x), 8, 4, 2).max(axis=2)
    else:
        for number, stride in enumerate(STRIDES[name]):
            x = keras_convolve(x, *layers.pop(0), stride, same=name == "commaai")
            last = number == len(STRIDES[name]) - 1
            if not (name == "commaai" and last):  # its last ELU stands behind the flattening
                x = activation(x)
            x = pool(x, {"lenet": 2, "tiny63": 4}.get(name, 1))
    x = x.reshape(len(x), -1)
    if name == "commaai":
        x = elu(x)
    for number, (kernel, bias) in enumerate(layers):
        x = x @ kernel + bias
        if number < len(layers) - 1:
            x = activation(x)
    return x


def predictions(name: str, path: Path, layers: list) -> tuple[np.ndarray, np.ndarray]:
    network, view = build(name)
    load_weights(network, str(path))
    pictures = np.random.default_rng(1).integers(0, 256, (2, *view.shape), dtype=np.uint8)
    with torch.no_grad():
        ours = network.eval()(torch.from_numpy(pictures).permute(0, 3, 1, 2)).numpy()
    return ours, keras_predict(name, pictures, layers)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("name", list(KERNELS))
def test_an_old_model_predicts_what_it_did(name: str, version: int, tmp_path: Path) -> None:
    layers = random_layers(KERNELS[name])
    ours, theirs = predictions(name, write_keras(tmp_path / "m.h5", layers, version), layers)
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-4)


def test_weights_alone_and_long_lists_of_names_load(tmp_path: Path) -> None:
    layers = random_layers(KERNELS["lenet"])
    path = write_keras(tmp_path / "w.h5", layers, whole_model=False, pieces=True)
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-4, atol=1e-4)


def channels_first(layers: list) -> list:
    """Return LeNet's layers as channels-first Keras 1 saves them: kernels (out, in, h, w)."""
    stored = [(k.transpose(3, 2, 0, 1) if k.ndim == 4 else k, b) for k, b in layers]
    kernel, bias = stored[2]
    by_channel = kernel.reshape(5, 13, 16, -1).transpose(2, 0, 1, 3).reshape(kernel.shape)
    return [*stored[:2], (by_channel, bias), *stored[3:]]


def turned(layers: list) -> list:
    """Return kernels (h, w, in, out) as Theano saves them: mirrored, since it convolves."""
    return [(k[::-1, ::-1] if k.ndim == 4 else k, b) for k, b in layers]


@pytest.mark.parametrize("whole_model", [True, False])
def test_channels_first_models_of_keras_1_load(whole_model: bool, tmp_path: Path) -> None:
    """A file of weights alone shows the order only by its kernels' shapes."""
    layers = random_layers(KERNELS["lenet"])
    config = {"convolution": {"dim_ordering": "th"}} if whole_model else None
    stored = channels_first(layers)
    path = write_keras(tmp_path / "th.h5", stored, 1, whole_model, config)
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-4, atol=1e-4)


def test_a_flatten_that_puts_the_channels_last_is_followed(tmp_path: Path) -> None:
    """Keras' Flatten does so from 2.2 on in channels-first models, for the weights' order."""
    layers = random_layers(KERNELS["lenet"])
    own = {"data_format": "channels_first"}
    config = {"convolution": own, "flatten": own}
    path = write_keras(tmp_path / "model.h5", layers, config=config)
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-4, atol=1e-4)


def test_channels_first_models_of_keras_2_before_that_flatten_load(tmp_path: Path) -> None:
    """Kernels are (h, w, in, out), but the flatten order is torch's."""
    layers = random_layers(KERNELS["lenet"])
    config = {"convolution": {"data_format": "channels_first"}}
    stored = [*layers[:2], channels_first(layers)[2], *layers[3:]]
    path = write_keras(tmp_path / "model.h5", stored, config=config)
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("version", [1, 2])
def test_theanos_kernels_are_turned_around(version: int, tmp_path: Path) -> None:
    layers = random_layers(KERNELS["lenet"])
    path = write_keras(tmp_path / "model.h5", turned(layers), version, backend=b"theano")
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-4, atol=1e-4)


def test_a_file_that_does_not_name_its_backend_is_taken_for_tensorflows(tmp_path: Path) -> None:
    stored = channels_first(random_layers(KERNELS["lenet"]))
    path = write_keras(tmp_path / "model.h5", stored, version=1, backend=b"")
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
    with pytest.raises(InputError) as caught:
        load_weights(network, str(path))
    message = str(caught.value)
    assert f"{path}: layer 6 of 9, dense_6: kernel 8448 x 100" in message
    assert "1152 x 100 in PilotNet" in message
    assert "set data.crop=[50,20] model.size=null: its input is 160 x 320 x 3" in message
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


def test_another_networks_file_is_refused(tmp_path: Path) -> None:
    path = write_keras(tmp_path / "model.h5", random_layers(KERNELS["lenet"]))
    with pytest.raises(InputError, match=r"has 5 layers with weights .* PilotNet has 9"):
        load_weights(build("nvidia")[0], str(path))


@pytest.mark.parametrize("content", [b"", b"not HDF5", b"\x89HDF\r\n\x1a\n" + b"\0" * 200])
def test_a_file_that_is_no_hdf5_is_named(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "model.h5").write_bytes(content)
    with pytest.raises(InputError, match=r"model\.h5"):
        load_weights(build("nvidia")[0], str(tmp_path / "model.h5"))


def test_keras_3s_weights_say_how_to_save_them(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "model.h5", "w") as file:
        file.create_group("layers/conv2d/vars")
    with pytest.raises(InputError, match=r"model\.save\('model\.h5'\)"):
        load_weights(build("nvidia")[0], str(tmp_path / "model.h5"))


@pytest.mark.parametrize("text", ["null", "[3]", '{"config": 3}', "[" * 100_000, "{"])
def test_a_damaged_model_config_is_one_line(text: str, tmp_path: Path) -> None:
    path = write_keras(tmp_path / "model.h5", random_layers(KERNELS["lenet"]))
    with h5py.File(path, "a") as file:
        file.attrs["model_config"] = text
    with pytest.raises(InputError, match=r"model\.h5: .*(copy|save)") as caught:
        load_weights(build("lenet")[0], str(path))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("dtype", [">f4", "f8", "f2"])
def test_floats_of_any_kind_load(dtype: str, tmp_path: Path) -> None:
    layers = random_layers(KERNELS["lenet"])
    stored = [(kernel.astype(dtype), bias.astype(dtype)) for kernel, bias in layers]
    path = write_keras(tmp_path / "model.h5", stored)
    np.testing.assert_allclose(*predictions("lenet", path, layers), rtol=1e-2, atol=1e-2)


def test_arrays_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    layers = random_layers(KERNELS["lenet"])
    path = write_keras(tmp_path / "model.h5", [(layers[0][0].astype("S8"), layers[0][1])])
    with pytest.raises(InputError, match="does not hold numbers; save"):
        load_weights(build("lenet")[0], str(path))


def test_without_h5py_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_keras(tmp_path / "model.h5", random_layers(KERNELS["lenet"]))
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InputError, match="pip install h5py"):
        read_keras(path)
