"""Whole Keras models converted: scales, Lambdas, orders of axes, and what is refused."""

import base64
import marshal
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.refusals import refusal
from tests.zoo.extras.keras import keras_reference
from tests.zoo.extras.keras.keras_files import (
    INPUT,
    Layer,
    lambda_config,
    random_weights,
    write_any,
    write_h5,
    write_json,
)
from zoo.base.errors import InputError
from zoo.extras.keras.keras_file import read_keras
from zoo.extras.keras.keras_lambda import describe_lambda, specs_of_word
from zoo.extras.keras.keras_layers import ConvertedKeras, convert
from zoo.extras.keras.keras_specs import specs_of
from zoo.extras.keras.layer_chain import build_layers
from zoo.extras.keras.sequential import Sequential

W = random_weights
SCALE = ("Lambda", lambda_config(lambda x: x / 127.5 - 1.0), [])
CONV: Layer = (
    "Conv2D",
    {"filters": 4, "kernel_size": [3, 3], "strides": [2, 2], "activation": "elu"},
    W((3, 3, 3, 4), (4,)),
)
REST: list[Layer] = [
    CONV,
    ("Flatten", {}, []),
    ("Dropout", {"rate": 0.5}, []),
    ("Dense", {"units": 1}, W((504, 1), (1,), seed=3)),
]
IMAGES = np.random.default_rng(0).integers(0, 256, (3, *INPUT), dtype=np.uint8)
tf = K = my_module = None  # names in Lambdas, which are never called


def network_of(converted: ConvertedKeras) -> Sequential:
    rows, columns, channels = converted.input_shape
    network = Sequential((channels, rows, columns), converted.layers, converted.scale)
    network.load_state_dict(converted.state)
    return network.eval()


def outputs(network: torch.nn.Module, images: np.ndarray = IMAGES) -> np.ndarray:
    with torch.inference_mode():
        return network.eval()(torch.from_numpy(images).permute(0, 3, 1, 2)).numpy()


def predict(converted: ConvertedKeras) -> np.ndarray:
    return outputs(network_of(converted))


def expected(layers: list[Layer], divisor: float = 127.5, less: float = 1.0) -> np.ndarray:
    return keras_reference.predict(IMAGES / divisor - less, layers)


def read(folder: Path, layers: list[Layer], **more: object):
    return read_keras(write_h5(folder / "m.h5", layers, **more))


@pytest.mark.parametrize("name", ["m.h5", "m.json", "m.keras"])
def test_a_model_predicts_what_it_did(name: str, tmp_path: Path) -> None:
    converted = convert(read_keras(write_any(tmp_path / name, [SCALE, *REST])))
    assert converted.input_shape == INPUT
    assert converted.scale == (127.5, 1.0)
    np.testing.assert_allclose(predict(converted), expected(REST), atol=1e-5)


def test_the_notes_tell_what_was_understood(tmp_path: Path) -> None:
    notes = convert(read(tmp_path, [SCALE, *REST])).notes
    assert [(note.position, note.name, note.kind) for note in notes][:2] == [
        (1, "lambda_1", "Lambda"),
        (2, "conv2d_1", "Conv2D"),
    ]
    assert "127.5" in notes[0].understood
    assert [note.shape for note in notes] == [INPUT, (9, 14, 4), (504,), (504,), (1,)]
    assert [note.parameters for note in notes] == [0, 112, 0, 0, 505]


def keras_1(layers: list[Layer], th: bool) -> list[Layer]:
    """Return layers with the classes, settings and kernels of Keras 1."""
    old_layers: list[Layer] = []
    for kind, config, weights in layers:
        weights, settings = list(weights), dict(config)
        if kind == "Conv2D":
            rows, columns = config["kernel_size"]
            kind = "Convolution2D"
            settings = {"nb_filter": config["filters"], "nb_row": rows, "nb_col": columns}
            settings |= {"subsample": config["strides"], "border_mode": "valid", "bias": True}
            settings |= {"activation": config["activation"], "dim_ordering": "th" if th else "tf"}
            weights[0] = weights[0].transpose(3, 2, 0, 1) if th else weights[0]
        elif kind == "Dense":
            settings = {"output_dim": config["units"], "bias": True, "activation": "linear"}
        elif kind == "Dropout":
            settings = {"p": config["rate"]}
        old_layers.append((kind, settings, weights))
    return old_layers


def test_keras_1_channels_last(tmp_path: Path) -> None:
    converted = convert(read(tmp_path, keras_1([SCALE, *REST], th=False), version=1))
    np.testing.assert_allclose(predict(converted), expected(REST), atol=1e-5)


@pytest.mark.parametrize("backend", ["theano", "tensorflow"])
def test_keras_1_channels_first(backend: str, tmp_path: Path) -> None:
    layers = [SCALE, *keras_1(REST, th=True)]
    if backend == "theano":
        layers[1][2][0] = layers[1][2][0][:, :, ::-1, ::-1]
    dense = layers[4][2][0]  # rows in the order channels, rows, columns
    layers[4][2][0] = dense.reshape(9, 14, 4).transpose(2, 0, 1).reshape(504, 1)
    shape = (INPUT[2], *INPUT[:2])
    converted = convert(read(tmp_path, layers, version=1, shape=shape, backend=backend))
    assert converted.input_shape == INPUT
    np.testing.assert_allclose(predict(converted), expected(REST), atol=1e-5)


def test_a_flatten_of_channels_first_puts_the_channels_last(tmp_path: Path) -> None:
    layers = [(k, c | {"data_format": "channels_first"}, w) for k, c, w in [SCALE, *REST]]
    shape = (INPUT[2], *INPUT[:2])
    converted = convert(read(tmp_path, layers, shape=shape))
    np.testing.assert_allclose(predict(converted), expected(REST), atol=1e-5)


@pytest.mark.parametrize(
    ("config", "first", "axis"),
    [({}, False, 1), ({}, True, 3), ({"axis": 1}, False, 2), ({"axis": 1}, True, 1)],
)
@pytest.mark.parametrize("kind", ["Softmax", "Conv2D"])
def test_a_softmax_is_over_keras_axis(kind: str, config: dict, first: bool, axis: int) -> None:
    activation = {"class_name": "Softmax", "config": config}
    conv = {"filters": 4, "kernel_size": [1, 1], "activation": activation}
    specs = specs_of(kind, config if kind == "Softmax" else conv, 3)
    modules, _ = build_layers(specs, (4, 4, 4), first)
    values = torch.nn.Sequential(*modules)(torch.rand(1, 4, 4, 4))
    torch.testing.assert_close(values.sum(axis), torch.ones(1, 4, 4))


LAMBDAS = {
    "x / 127.5 - 1": (lambda x: x / 127.5 - 1, (127.5, 1.0)),
    "-1 + x / 127.5": (lambda x: -1.0 + x / 127.5, (127.5, 1.0)),
    "x / 255 - 0.5": (lambda x: (x / 255.0) - 0.5, (255.0, 0.5)),
    "x / 255": (lambda x: x / 255, (255.0, 0.0)),
    "(x - 128) / 128": (lambda x: (x - 128) / 128, (128.0, 1.0)),
    "x / 128 - 1": (lambda x: x / 128.0 - 1.0, (128.0, 1.0)),
    "2 * x / 255 - 1": (lambda x: 2 * x / 255 - 1, (127.5, 1.0)),
    "x": (lambda x: x, None),
}


@pytest.mark.parametrize("style", ["base64", "escape", "keras3"])
@pytest.mark.parametrize("name", LAMBDAS)
def test_a_scale_is_read_from_a_lambdas_code(name: str, style: str, tmp_path: Path) -> None:
    function, scale = LAMBDAS[name]
    converted = convert(read(tmp_path, [("Lambda", lambda_config(function, style), []), *REST]))
    assert converted.scale == scale
    if scale:
        np.testing.assert_allclose(predict(converted), expected(REST, *scale), atol=1e-4)


# Code of other Pythons, as they marshal `lambda x: x / 127.5 - 1.0`.
PYTHON_27 = (
    b"c\x01\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00C\x00\x00\x00s\x0c\x00\x00\x00|\x00\x00d"
    b"\x01\x00\x15d\x02\x00\x18S(\x03\x00\x00\x00Ng\x00\x00\x00\x00\x00\xe0_@g\x00\x00\x00\x00\x00"
    b"\x00\xf0?(\x00\x00\x00\x00(\x01\x00\x00\x00t\x01\x00\x00\x00x(\x00\x00\x00\x00(\x00\x00\x00"
    b"\x00s\x01\x00\x00\x00at\x08\x00\x00\x00<lambda>\x01\x00\x00\x00s\x00\x00\x00\x00"
)
PYTHON_35 = (
    b"\xe3\x01\x00\x00\x00\x00\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00C\x00\x00\x00s\x0c\x00"
    b"\x00\x00|\x00\x00d\x01\x00\x1bd\x02\x00\x18S)\x03Ng\x00\x00\x00\x00\x00\xe0_@g\x00\x00\x00"
    b"\x00\x00\x00\xf0?\xa9\x00)\x01\xda\x01xr\x01\x00\x00\x00r\x01\x00\x00\x00z\x01a\xda\x08"
    b"<lambda>\x01\x00\x00\x00s\x00\x00\x00\x00"
)
PYTHON_38 = (
    b"\xe3\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00C\x00"
    b"\x00\x00s\x0c\x00\x00\x00|\x00d\x01\x1b\x00d\x02\x18\x00S\x00)\x03Ng\x00\x00\x00\x00\x00"
    b"\xe0_@g\x00\x00\x00\x00\x00\x00\xf0?\xa9\x00)\x01\xda\x01xr\x01\x00\x00\x00r\x01\x00\x00\x00"
    b"z\x01a\xda\x08<lambda>\x01\x00\x00\x00s\x00\x00\x00\x00"
)


@pytest.mark.parametrize("code", [PYTHON_27, PYTHON_35, PYTHON_38], ids=["2.7", "3.5", "3.8"])
def test_code_of_other_pythons_is_read(code: bytes) -> None:
    for text in (base64.encodebytes(code).decode(), code.decode("raw_unicode_escape")):
        assert describe_lambda({"function": [text, None, None]})[0] == "scale:127.5:1"


# Functions as in old solutions; they are never called.
def resized_within(x):
    import tensorflow as ktf

    return ktf.image.resize_images(x, (64, 64))


def resized_and_scaled(x):
    from keras.backend import tf

    y = tf.image.resize(x, (66, 200))
    return y / 255.0 - 0.5


def scaled_by_local_variables(x):
    a = -0.1
    b = 0.1
    x_min = 0
    x_max = 255
    return a + (x - x_min) * (b - a) / (x_max - x_min)


@pytest.mark.parametrize(
    ("function", "word"),
    [
        (lambda x: tf.atan(x), "atan"),
        (lambda x: tf.multiply(tf.atan(x), 2), "atan:2"),
        (lambda x: tf.image.resize_images(x, (66, 200)), "resize:66:200:linear_tf1"),
        (lambda x: tf.image.resize(x, (66, 200)), "resize:66:200:linear"),
        (lambda x: tf.image.rgb_to_grayscale(x), "gray"),
        (lambda x: K.tanh(x), "tanh"),
        (lambda x: 2 * tf.atan(x), "atan:2"),
        (lambda x: tf.compat.v1.image.resize(x, (66, 200)), "resize:66:200:linear_tf1"),
        (lambda x: tf.atan(x / 2), "scale:2:-0+atan"),
        (lambda x: tf.atan(x) / 2, "atan:0.5"),
        (lambda x: tf.atan(tf.multiply(x, 2)), "scale:0.5:-0+atan"),
        (lambda x: -tf.atan(x), "atan:-1"),
        (lambda x: tf.tanh(tf.tanh(x)), "tanh+tanh"),
        (
            lambda x: tf.image.resize_images(x, [66, 200], align_corners=True),
            "resize:66:200:linear_corners",
        ),
        (resized_within, "resize:64:64:linear_tf1"),
        (resized_and_scaled, "resize:66:200:linear+scale:255:0.5"),
        (scaled_by_local_variables, "scale:1275:0.1"),
        (lambda x: x[:, 60:-25, :, :], "crop:60:25"),
        (lambda x: x[:, 60:-25, 0:320] / 255.0, "crop:60:25+scale:255:-0"),
        (lambda x: x[:, 60:135, 0:320, :], None),
        (lambda x: x[:, 60:-25, 100:200], None),
        (lambda x: x[:, ::2], None),
        (lambda x: x[:, 60:-25, :, ::-1], None),
        (lambda x: x[0, 60:-25], None),
        (lambda x: my_module.tanh(x), None),
        (lambda x, y=2: x / y, None),
        (lambda x: tf.tanh(x) + x, None),
        (lambda x: tf.tanh(x + x), "scale:0.5:-0+tanh"),
        (lambda x: K.resize_images(x, 2, 2), None),
        (lambda x: tf.image.resize(x, (66, 200), method="nearest"), None),
        (lambda x: tf.image.resize(x, (66, 200), method="area"), "resize:66:200:area"),
        (
            lambda x: K.tf.image.resize_images(x, (6, 9), method=K.tf.image.ResizeMethod.AREA) / 4,
            "resize:6:9:area+scale:4:-0",
        ),
        (lambda x: tf.image.resize_images(x, (6, 9), method=K.ResizeMethod.CUBIC), None),
        (lambda x: x * x, None),
        (lambda x: x[:, 60:], "crop:60:0"),
        (lambda x: 1 / x, None),
        (lambda x: tf.image.resize(x, size=(66, 200)) / 255.0, "resize:66:200:linear+scale:255:-0"),
        (lambda x: [y / 255.0 for y in x], None),
    ],
)
def test_other_lambdas_get_a_word_or_are_asked_for(function, word: str | None) -> None:
    assert describe_lambda(lambda_config(function))[0] == word
    assert word is None or specs_of_word(word)


@pytest.mark.parametrize(
    "config",
    [{}, {"function": 3}, {"function": []}, {"function": [None]}, {"function": "my_scale"},
     {"function": ["", None, None]}, {"function": ["gARLAS4=", None, None]},
     {"function": {"class_name": "__lambda__", "config": {"code": 3}}},
     {"function": {"config": 7}}, {"function": ["4wEAAAA", None, None]},
     {"function": [base64.b64encode(b"\xa9\xff" * 1000).decode(), None, None]},
     {"function": [base64.b64encode(b"(\xff\xff\xff\x7f" * 10).decode(), None, None]},
     {"function": [base64.b64encode(b")\x01" * 5000).decode(), None, None]}],
)  # fmt: skip
def test_code_that_is_none_is_unclear(config: dict) -> None:
    assert describe_lambda(config)[0] is None


def test_no_lambda_is_run_or_unmarshalled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def attack(x):
        (tmp_path / "ran").touch()
        return x / 127.5 - 1.0

    config = lambda_config(attack)
    monkeypatch.setattr(marshal, "loads", lambda _: pytest.fail("unmarshalled"))
    with pytest.raises(InputError, match=r"lambda_1 .*touch"):
        convert(read(tmp_path, [("Lambda", config, []), *REST]))
    assert not (tmp_path / "ran").exists()


UNCLEAR: Layer = ("Lambda", lambda_config(lambda x: x * x), [])


def test_an_unclear_lambda_is_asked_for_by_key(tmp_path: Path) -> None:
    model = read(tmp_path, [UNCLEAR, *REST])
    message = refusal(convert, model)
    assert f"{model.path}: layer 1 of 5, lambda_1 (Lambda)" in message
    assert 'set "scale=[divisor,subtracted]"' in message
    assert "lambdas=[WORD]" in message
    converted = convert(model, scale=[255, 0.5])
    assert converted.scale == (255, 0.5)
    np.testing.assert_allclose(predict(converted), expected(REST, 255, 0.5), atol=1e-4)
    assert convert(model, lambdas=["scale:255:0.5"]).scale == (255, 0.5)
    assert convert(model, lambdas=["identity"]).scale is None


@pytest.mark.parametrize(("version", "name"), [(2, "hard_sigmoid"), (3, "hard_sigmoid_3")])
def test_a_lambdas_hard_sigmoid_is_of_its_keras(version: int, name: str, tmp_path: Path) -> None:
    function: Layer = ("Lambda", lambda_config(lambda x: K.hard_sigmoid(x)), [])
    converted = convert(read(tmp_path, [SCALE, CONV, function, *REST[1:]], version=version))
    assert converted.layers[1] == {"layer": "Activation", "activation": name}
    activated = keras_reference.ACTIVATIONS[name](expected([CONV]))
    wanted = keras_reference.predict(activated, REST[1:])
    np.testing.assert_allclose(predict(converted), wanted, atol=1e-5)


def test_words_are_used_in_order(tmp_path: Path) -> None:
    layers = [SCALE, CONV, UNCLEAR, *REST[1:], UNCLEAR]
    assert "layer 3 of 7, lambda_2" in refusal(convert, read(tmp_path, layers), scale=[1, 0])
    converted = convert(read(tmp_path, layers), lambdas=["tanh", "atan:2"])
    wanted = 2 * np.arctan(keras_reference.predict(np.tanh(expected([CONV])), REST[1:]))
    np.testing.assert_allclose(predict(converted), wanted, atol=1e-5)


@pytest.mark.parametrize(
    "word",
    ["eval", "resize:66", "crop:1.5:2", "scale:0:1", "scale:nan:1", "scale:1e-320:1",
     "scale:1:1e300", "atan:inf"],
)  # fmt: skip
def test_a_wrong_word_is_named(word: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"lambdas={word}: is none of"):
        convert(read(tmp_path, [UNCLEAR, *REST]), lambdas=[word])


def test_a_scale_after_a_crop_is_the_networks(tmp_path: Path) -> None:
    crop: Layer = ("Cropping2D", {"cropping": [[2, 1], [1, 0]]}, [])
    dense: Layer = ("Dense", {"units": 1}, W((448, 1), (1,)))
    result = convert(read(tmp_path, [crop, SCALE, CONV, REST[1], dense]))
    assert result.scale == (127.5, 1)
    np.testing.assert_allclose(predict(result), expected([crop, CONV, REST[1], dense]), atol=1e-5)


def test_a_scale_after_a_padding_stays_there(tmp_path: Path) -> None:
    """A padding of 0 before the scale is black, not gray."""
    pad: Layer = ("ZeroPadding2D", {"padding": [[1, 1], [1, 1]]}, [])
    rescaling: Layer = ("Rescaling", {"scale": 1 / 127.5, "offset": -1}, [])
    dense: Layer = ("Dense", {"units": 1}, W((600, 1), (1,)))
    converted = convert(read(tmp_path, [pad, SCALE, CONV, REST[1], dense]), scale=[1, 0])
    wanted = expected([pad, rescaling, CONV, REST[1], dense], 1, 0)
    np.testing.assert_allclose(predict(converted), wanted, atol=1e-5)
    for layer, scale in (
        (SCALE, (1.0, 0.0)),
        (("Rescaling", {"scale": 1, "offset": -0.5}, []), None),
        (("Rescaling", {"scale": [0.017, 0.018, 0.017], "offset": [-2.1, -2, -1.8]}, []), (1, 0)),
        (("Rescaling", {"scale": [4.4, 4.5, 4.4], "offset": [-2.1, -2, -1.8]}, []), None),
    ):
        # x - 0.5 follows an x / 255 in the user's program.
        assert convert(read(tmp_path, [pad, layer, CONV, REST[1], dense])).scale == scale


def test_two_scales_are_one_and_half_of_a_scale_is_none(tmp_path: Path) -> None:
    divided, shifted = (
        ("Lambda", lambda_config(function), [])
        for function in (lambda x: x / 255.0, lambda x: x - 0.5)
    )
    assert convert(read(tmp_path, [divided, shifted, *REST])).scale == (255, 0.5)
    # The other half, x / 255, stands in the user's program.
    half = read(tmp_path, [shifted, *REST])
    assert convert(half).scale is None
    assert convert(half, scale=[255, 0.5]).scale == (255, 0.5)


def test_a_lambda_that_resizes_and_scales_does_both(tmp_path: Path) -> None:
    layers = [("Lambda", lambda_config(lambda x: tf.image.resize(x, (20, 30)) / 255.0), []), *REST]
    converted = convert(read(tmp_path, layers, shape=(40, 60, 3)))
    assert converted.scale == (255, 0)
    assert converted.input_shape == (40, 60, 3)
    assert converted.layers[0] == {"layer": "Resize", "size": [20, 30], "method": "linear"}


def test_rows_of_an_index_are_a_crop_of_the_input(tmp_path: Path) -> None:
    layers = [("Lambda", lambda_config(lambda x: x[:, 10:30, :, :]), []), *REST]
    converted = convert(read(tmp_path, layers, shape=(40, 30, 3)))
    assert converted.layers[0] == {"layer": "Cropping2D", "cropping": [[10, 10], [0, 0]]}


def test_an_unclear_lambda_that_does_more_than_scale_is_named(tmp_path: Path) -> None:
    model = read(tmp_path, [UNCLEAR, *REST], shape=(40, 60, 3))
    with pytest.raises(InputError, match=r'Lambda.*lambdas=\[WORD\]" for layer 1 of 5, lambda_1'):
        convert(model, scale=[255, 0.5])


@pytest.mark.parametrize("crop", [[], [("Cropping2D", {"cropping": [[0, 0], [0, 0]]}, [])]])
def test_a_normalization_of_pixels_needs_no_scale(crop: list[Layer], tmp_path: Path) -> None:
    for mean, scale in ((110, (1.0, 0.0)), (0.1, None)):
        numbers = {"mean": [mean] * 3, "variance": [2000.0] * 3}
        layers: list[Layer] = [*crop, ("Normalization", numbers, []), *REST]
        assert convert(read(tmp_path, layers)).scale == scale
        means = [*W((3,), (3,)), np.full(3, mean, np.float32), *W((3,))]
        layers = [*crop, ("BatchNormalization", {}, means), *REST]
        assert convert(read(tmp_path, layers)).scale == scale
    converted = convert(read(tmp_path, layers), scale=[255, 0])
    np.testing.assert_allclose(predict(converted), expected(layers, 255, 0), atol=1e-4)


def test_theanos_same_padding_is_its_own(tmp_path: Path) -> None:
    """Theano pads half a window in front, TensorFlow a pixel less where the stride is 2."""
    same = CONV[1] | {"padding": "same", "activation": "linear"}
    kernel = np.zeros((3, 3, 3, 4), np.float32)
    kernel[1, 1] = 1  # each output is the pixel in the middle of its window
    ramp = torch.arange(600.0).reshape(1, 1, 20, 30).expand(1, 3, 20, 30)
    layers: list[Layer] = [
        SCALE,
        ("Conv2D", same, [kernel, np.zeros(4, np.float32)]),
        ("GlobalMaxPooling2D", {}, []),
        ("Dense", {"units": 1}, W((4, 1), (1,))),
    ]
    outs = {}
    for backend in ("theano", "tensorflow"):
        network = network_of(convert(read(tmp_path, layers, backend=backend)))
        outs[backend] = network.layers[0](ramp)
    assert outs["theano"].shape == outs["tensorflow"].shape == (1, 4, 10, 15)
    assert outs["theano"][0, 0, 0, :3].tolist() == [0, 6, 12]
    assert outs["tensorflow"][0, 0, 0, :3].tolist() == [93, 99, 105]


def test_an_input_without_a_size_is_asked_for(tmp_path: Path) -> None:
    for shape in (None, (None, None, 3)):
        model = read(tmp_path, [SCALE, *REST], shape=shape)
        assert "size=[66,200]" in refusal(convert, model)
        converted = convert(model, size=INPUT[:2])
        np.testing.assert_allclose(predict(converted), expected(REST), atol=1e-5)
        with pytest.raises(InputError, match=r"layer 5 of 5, dense_1 .*: its kernel is 504 x 1"):
            convert(model, size=[30, 30])


def test_two_outputs_are_asked_for(tmp_path: Path) -> None:
    layers = [SCALE, *REST[:3], ("Dense", {"units": 2}, W((504, 2), (2,)))]
    model = read(tmp_path, layers)
    assert 'drivezoo import FILE "outputs=[steering,throttle]"' in refusal(convert, model)
    wanted = expected(layers[1:])
    both = convert(model, outputs=["throttle", "steering"])
    np.testing.assert_allclose(predict(both), wanted[:, ::-1], atol=1e-5)
    steering = convert(model, outputs=["ignored", "steering"])
    np.testing.assert_allclose(predict(steering), wanted[:, 1:], atol=1e-5)
    for wrong in (["steering"], ["steering", "steering"], ["steering", "brake"]):
        assert "outputs=" in refusal(convert, model, outputs=wrong)


def test_a_network_of_another_task_is_refused(tmp_path: Path) -> None:
    dense: Layer = ("Dense", {"units": 10, "activation": "softmax"}, W((504, 10), (10,)))
    with pytest.raises(InputError, match=r"has 10 outputs, .*another task"):
        convert(read(tmp_path, [SCALE, *REST[:3], dense]))


@pytest.mark.parametrize(
    ("layer", "words"),
    [
        (("LSTM", {"units": 4}, []), r"layer 2 of 6, lstm_1 \(LSTM\): needs several frames"),
        (("ConvLSTM2D", {}, []), "needs several frames"),
        (("Highway", {}, []), r"layer 2 of 6, highway_1 \(Highway\): is an unknown layer"),
        (("Highway", {"name": "my\nlayer"}, []), r"layer 2 of 6, my\\nlayer \(Highway\)"),
        (("TFOpLambda", {"function": "os.system"}, []), "unknown layer"),
        (("Activation", {"activation": "my_own"}, []), "its activation is my_own"),
        (("BatchNormalization", {"mode": 1}, W(*[(3,)] * 4)), "mode is 1"),
        (("Conv2D", {"filters": -1, "kernel_size": [3, 3]}, CONV[2]), "layer 2 of 6.*filters=-1"),
        (("Conv2D", {"filters": "4", "kernel_size": [3, 3]}, CONV[2]), "filters='4'"),
        (("MaxPooling2D", {"pool_size": [60, 60]}, []), "layer 2 of 6.*does not fit the input"),
        (("Dropout", {"rate": [0.5]}, []), r"rate=\[0.5\]"),
    ],
)
def test_a_layer_that_cannot_be_converted_is_named(layer: Layer, words: str, tmp_path) -> None:
    with pytest.raises(InputError, match=rf"m\.h5: .*{words}") as caught:
        convert(read(tmp_path, [SCALE, layer, *REST]))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("weights", "words"),
    [
        ([], "has 0 arrays of weights in the file, and needs 2"),
        (W((3, 3, 3, 5), (5,)), r"its kernel is 3 x 3 x 3 x 5 in the file, 3 x 3 x 3 x 4"),
        (W((3, 3, 3, 4), (5,)), r"its bias is 5 in the file, 4 "),
        ([CONV[2][0] * np.nan, CONV[2][1]], "NaN"),
    ],
)
def test_weights_that_do_not_fit_are_named(weights: list, words: str, tmp_path: Path) -> None:
    layer = (CONV[0], CONV[1], weights)
    with pytest.raises(InputError, match=rf"layer 2 of 5, conv2d_1 \(Conv2D\): .*{words}"):
        convert(read(tmp_path, [SCALE, layer, *REST[1:]]))


@pytest.mark.parametrize(
    ("shape", "words"),
    [((20, 30, 6), "6 channels"), ((100,), "not an image"), ((2, 20, 30, 3), "not an image"),
     ((0, 30, 3), "not 1 to 4096"), ((20, 1e9, 3), "not 1 to 4096"), (("a", 30, 3), "not 1 to")],
)  # fmt: skip
def test_an_input_that_is_no_image_is_refused(shape: tuple, words: str, tmp_path: Path) -> None:
    assert words in refusal(convert, read(tmp_path, [SCALE, *REST], shape=shape))


def test_weights_without_their_architecture_are_refused(tmp_path: Path) -> None:
    write_json(tmp_path / "other.json", [SCALE, *REST])
    (tmp_path / "other.json").unlink()
    with pytest.raises(InputError, match=r"without the architecture; name the model's \.json"):
        convert(read_keras(tmp_path / "other.h5"))


def test_an_activation_that_is_a_layer(tmp_path: Path) -> None:
    activation = {"class_name": "LeakyReLU", "config": {"alpha": 0.1}}
    conv = (CONV[0], CONV[1] | {"activation": activation}, CONV[2])
    plain = (CONV[0], CONV[1] | {"activation": "linear"}, CONV[2])
    converted = convert(read(tmp_path, [SCALE, conv, *REST[1:]]))
    wanted = expected([plain, ("LeakyReLU", {"alpha": 0.1}, []), *REST[1:]])
    np.testing.assert_allclose(predict(converted), wanted, atol=1e-5)
