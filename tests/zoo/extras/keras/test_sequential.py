"""Every layer of `Sequential` against Keras' definition in NumPy."""

from pathlib import Path

import numpy as np
import pytest
import torch

from datamodules.view import View
from tests.zoo.extras.keras import keras_reference
from tests.zoo.extras.keras.keras_files import Layer, random_weights, write_h5
from tests.zoo.extras.keras.test_keras_layers import network_of as converted_network
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.extras.keras.keras_file import read_keras
from zoo.extras.keras.keras_layers import convert
from zoo.extras.keras.sequential import Sequential
from zoo.models.make_network import make_network
from zoo.scoring.visual_backprop import Saliency

W = random_weights
SHAPE = (13, 17, 3)
CONV = ("Conv2D", {"filters": 4, "kernel_size": [3, 3]}, W((3, 3, 3, 4), (4,)))
PAIRS = [(size, stride) for size in (1, 2, 3, 4, 5) for stride in (1, 2, 3)]

CASES: dict[str, list[Layer]] = {
    **{
        f"same {size} {stride}": [
            ("Conv2D", {"filters": 4, "kernel_size": [size, size], "strides": [stride, stride],
                        "padding": "same"}, W((size, size, 3, 4), (4,))),
            ("MaxPooling2D", {"pool_size": [size, size], "strides": [stride, stride],
                              "padding": "same"}, []),
            ("AveragePooling2D", {"pool_size": [size, size], "strides": [stride, stride],
                                  "padding": "same"}, []),
        ]
        for size, stride in PAIRS
    },
    **{
        f"activation {name}": [
            ("Conv2D", {"filters": 4, "kernel_size": [3, 3], "activation": name}, CONV[2]),
            ("Activation", {"activation": name}, []),
        ]
        for name in keras_reference.ACTIVATIONS
    },
    "strides": [("Conv2D", {"filters": 4, "kernel_size": [3, 5], "strides": [2, 3],
                            "use_bias": False}, W((3, 5, 3, 4)))],
    "dilation": [("Conv2D", {"filters": 4, "kernel_size": [3, 2], "dilation_rate": [2, 3],
                             "padding": "same"}, W((3, 2, 3, 4), (4,)))],
    "groups": [("Conv2D", {"filters": 6, "kernel_size": [3, 3], "groups": 3},
                W((3, 3, 1, 6), (6,)))],
    "depthwise": [("DepthwiseConv2D", {"kernel_size": [3, 3], "depth_multiplier": 2},
                   W((3, 3, 3, 2), (6,)))],
    "separable": [("SeparableConv2D", {"filters": 4, "kernel_size": [3, 4], "padding": "same",
                                       "strides": [2, 2], "depth_multiplier": 2},
                   W((3, 4, 3, 2), (1, 1, 6, 4), (4,)))],
    "pools": [("MaxPooling2D", {"pool_size": [2, 3]}, []),
              ("AveragePooling2D", {"pool_size": [3, 2], "strides": [1, 1]}, [])],
    "global mean": [CONV, ("GlobalAveragePooling2D", {}, [])],
    "global max": [CONV, ("GlobalMaxPooling2D", {}, [])],
    "batch norm first": [("BatchNormalization", {"epsilon": 0.01}, W((3,), (3,), (3,), (3,)))],
    "batch norm of rows": [("BatchNormalization", {"axis": 1}, W((13,), (13,), (13,), (13,)))],
    "batch norm of columns": [("BatchNormalization", {"axis": 2}, W((17,), (17,), (17,), (17,)))],
    "batch norm flags": [
        ("BatchNormalization", {"center": False}, W((3,), (3,), (3,))),
        ("BatchNormalization", {"scale": False}, W((3,), (3,), (3,), seed=1)),
        ("BatchNormalization", {"scale": False, "center": False}, W((3,), (3,), seed=2)),
    ],
    "batch norm of features": [CONV, ("Flatten", {}, []), ("BatchNormalization", {},
                                                           W(*[(660,)] * 4))],
    "elu": [CONV, ("ELU", {"alpha": 0.6}, []), ("LeakyReLU", {"alpha": 0.2}, [])],
    "prelu": [CONV, ("PReLU", {}, W((11, 15, 4)))],
    "prelu shared": [CONV, ("PReLU", {"shared_axes": [1, 2]}, W((1, 1, 4)))],
    "prelu of features": [("Flatten", {}, []), ("PReLU", {}, W((663,)))],
    "relu": [CONV, ("ReLU", {"max_value": 0.5, "negative_slope": 0.1, "threshold": 0.2}, [])],
    "crop": [("Cropping2D", {"cropping": [[2, 1], [3, 0]]}, [])],
    "zero padding": [("ZeroPadding2D", {"padding": [[2, 1], [3, 0]]}, []), CONV],
    "reshape": [CONV, ("Reshape", {"target_shape": [11, 60]}, []),
                ("Reshape", {"target_shape": [4, 15, 11]}, []),
                ("Permute", {"dims": [3, 1, 2]}, [])],
    "dense on pixels": [CONV, ("Dense", {"units": 2, "activation": "tanh"}, W((4, 2), (2,)))],
    "rescaling": [CONV, ("Rescaling", {"scale": [1.0, 2.0, 3.0, 4.0], "offset": 0.5}, [])],
    "noise": [("Dropout", {"rate": 0.5}, []), ("SpatialDropout2D", {"rate": 0.5}, []),
              ("GaussianNoise", {"stddev": 0.5}, [])],
}  # fmt: skip


def whole(layers: list[Layer]) -> list[Layer]:
    """Return layers with a scale before and a dense layer after them, and random weights."""
    scale: Layer = ("Rescaling", {"scale": 1 / 127.5, "offset": -1.0}, [])
    ones = keras_reference.predict(np.zeros((1, *SHAPE)), layers)
    dense: Layer = ("Dense", {"units": 1}, W((ones.size, 1), (1,), seed=3))
    return [scale, *layers, *([("Flatten", {}, [])] if ones.ndim > 2 else []), dense]


def network_of(layers: list[Layer], path: Path) -> Sequential:
    return converted_network(convert(read_keras(write_h5(path, layers, shape=SHAPE))))


def images() -> np.ndarray:
    return np.random.default_rng(5).integers(0, 256, (3, *SHAPE), dtype=np.uint8)


@pytest.mark.parametrize("name", CASES)
def test_a_layer_computes_what_keras_defines(name: str, tmp_path) -> None:
    layers = whole(CASES[name])
    network = network_of(layers, tmp_path / "model.h5")
    pixels, defined = torch.from_numpy(images()).permute(0, 3, 1, 2), keras_reference.predict
    with torch.inference_mode():
        ours, doubled = network(pixels).numpy(), network.double()(pixels)
    assert doubled.dtype == torch.float64, "a drive that is scored computes so"
    for out in (ours, doubled):
        np.testing.assert_allclose(out, defined(images(), layers), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", ["same 3 2", "separable", "prelu", "batch norm of rows", "noise"])
def test_a_layer_trains(name: str, tmp_path) -> None:
    network = network_of(whole(CASES[name]), tmp_path / "model.h5").train()
    network(torch.from_numpy(images()).permute(0, 3, 1, 2)).square().mean().backward()
    for parameter, tensor in network.named_parameters():
        assert tensor.grad is None or torch.isfinite(tensor.grad).all(), parameter
    single = network(torch.from_numpy(images()[:1]).permute(0, 3, 1, 2))
    assert torch.isfinite(single).all(), "a batch of one has no variance"


RICH: list[Layer] = [
    ("Cropping2D", {"cropping": [[2, 1], [1, 0]]}, []),
    ("ZeroPadding2D", {"padding": [[1, 0], [0, 2]]}, []),
    *CASES["separable"],
    ("Conv2D", {"filters": 4, "kernel_size": [2, 2], "padding": "same"}, W((2, 2, 4, 4), (4,))),
    ("AveragePooling2D", {"pool_size": [2, 2], "padding": "same"}, []),
    ("PReLU", {"shared_axes": [1, 2]}, W((1, 1, 4))),
    ("BatchNormalization", {"axis": 1}, W(*[(3,)] * 4)),
]


def test_a_network_of_many_layers_explains_itself_and_exports(tmp_path) -> None:
    network = network_of(whole(RICH), tmp_path / "model.h5")
    view = View([0, 0], "rgb", SHAPE[:2])
    checkpoint = Checkpoint(network, view, {"model": {"name": "keras"}}, {"rows": 3})
    frame = np.random.default_rng(0).integers(0, 256, (160, 320, 3), dtype=np.uint8)
    policy = CheckpointPolicy(checkpoint)
    for published in (False, True):
        where = Saliency(policy, published)(frame, 9.0)
        assert where.shape == (160, 320)
        assert where.max() == pytest.approx(1)
        assert where[:20].max() < where.max(), "the cropped rows are not seen"
    (tmp_path / "model.onnx").write_bytes(onnx_bytes(checkpoint))
    exported = load_policy(tmp_path / "model.onnx")
    assert exported(frame, 9.0)[0] == pytest.approx(policy(frame, 9.0)[0], abs=1e-5)


@pytest.mark.parametrize(
    ("method", "columns"),
    [
        ("linear", [0.5, 2.5]),
        ("linear_tf1", [0, 2]),
        ("nearest", [1, 3]),
        ("nearest_tf1", [0, 2]),
        ("area", [0.5, 2.5]),
    ],
)
def test_tensorflow_1_and_2_sample_other_points(method: str, columns: list[float]) -> None:
    def resized(images: torch.Tensor, size: list[int]) -> torch.Tensor:
        resize = {"layer": "Resize", "size": size, "method": method}
        layers = [resize, {"layer": "Flatten"}, {"layer": "Dense", "units": 1}]
        return Sequential(tuple(images.shape[1:]), layers).layers[0](images)

    ramp = torch.arange(4.0).expand(1, 1, 4, 4)
    assert resized(ramp, [4, 2])[0, 0, 0].tolist() == columns
    constant = resized(torch.full((1, 3, 13, 17), 7.0), [7, 9])
    torch.testing.assert_close(constant, torch.full((1, 3, 7, 9), 7.0))


WRONG = [
    (3, "is not a list"),
    ([], "is not a list"),
    ([{"layer": "Dense", "units": 1}] * 1001, "is not a list"),
    (["Dense"], "layer 1 is None"),
    ([{"layer": "os.system"}], "no known layer"),
    ([{"layer": ["Dense"]}], "no known layer"),
    ([{"layer": "Dense"}], "layer 1 of 1 .Dense.: lacks units"),
    ([{"layer": "Dense", "units": 0}], "units=0 is not whole"),
    ([{"layer": "Dense", "units": True}], "units=True is not whole"),
    ([{"layer": "Dense", "units": 1, "code": "x"}], "has no setting 'code'"),
    ([{"layer": "Dense", "units": 1, "activation": "eval"}], "activation='eval'"),
    ([{"layer": "Conv2D", "filters": 1, "kernel_size": 3}], "kernel_size=3 is not a list"),
    ([{"layer": "Conv2D", "filters": 1, "kernel_size": [30, 30]}], "does not fit the input of"),
    ([{"layer": "Conv2D", "filters": 1, "kernel_size": [3, 3], "padding": "full"}], "padding"),
    ([{"layer": "Conv2D", "filters": 4, "kernel_size": [1, 1], "groups": 2}], "groups=2"),
    ([{"layer": "Dropout", "rate": 1.0}], "rate=1.0 is not a rate"),
    ([{"layer": "Dropout", "rate": float("nan")}], "rate=nan is not a number"),
    ([{"layer": "Cropping2D", "cropping": [[9, 9], [0, 0]]}], "would be -5 x 17 x 3.*empty"),
    ([{"layer": "ZeroPadding2D", "padding": [[4096, 4096], [4096, 4096]]}], "too large"),
    ([{"layer": "Reshape", "target_shape": [5]}], "target_shape.*663"),
    ([{"layer": "BatchNormalization", "axis": 0}], "axis"),
    ([{"layer": "Flatten"}, {"layer": "Conv2D"}], "layer 2 of 2.*needs images"),
    ([{"layer": "Flatten"}, {"layer": "Dense", "units": 3}], "has 3 outputs"),
    ([{"layer": "Flatten"}, {"layer": "Select", "columns": [663]}], "columns"),
    # What a stranger writes to exhaust the machine.
    ([{"layer": "Dense", "units": 10_000_000}] * 9, "13 x 17 x 10000000, which is too large"),
    ([{"layer": "Flatten"}, {"layer": "Dense", "units": 9_000_000}], "1,000,000,000"),
    ([{"layer": "Conv2D", "filters": 60_000, "kernel_size": [1, 1]}] * 2, "1,000,000,000"),
    (
        [{"layer": "Conv2D", "filters": 3, "kernel_size": [3, 3], "padding": "same"}] * 99
        + [{"layer": "Resize", "size": [4096, 4096]}],
        "has 50331648 outputs",
    ),
]


@pytest.mark.parametrize(("layers", "words"), WRONG, ids=[str(spec)[:60] for spec, _ in WRONG])
def test_a_wrong_spec_is_named(layers: object, words: str) -> None:
    model = {"_target_": "zoo.extras.keras.sequential.Sequential", "layers": layers}
    with pytest.raises(InputError, match=words) as caught:
        make_network(model, View([0, 0], "rgb", SHAPE[:2]))
    assert len(str(caught.value)) < 2000
