"""Networks of Donkeycar: two outputs, linear or in bins, of frames / 255."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.zoo.extras.keras.keras_files import (
    Layer,
    functional,
    random_weights,
    write_h5,
    write_keras,
)
from tests.zoo.extras.keras.test_keras_layers import network_of, outputs
from zoo.base.errors import InputError
from zoo.extras.keras.keras_file import read_keras
from zoo.extras.keras.keras_layers import ConvertedKeras, convert

SHAPE = (12, 16, 3)
HIDDEN = 16
LINEAR, BINS = ("n_outputs0", "n_outputs1"), ("angle_out", "throttle_out")


def donkeycar_layers(names: tuple[str, ...], units: tuple[int, ...], activation: str) -> list:
    """Return layers of a network whose outputs have these names and numbers of units."""
    rows, columns, channels = SHAPE
    kernel, bias = random_weights((rows * columns * channels, HIDDEN), (HIDDEN,))
    hidden = [10 * kernel, bias]  # so that the images differ in the largest bin
    layers: list[Layer] = [
        ("Flatten", {"name": "flattened"}, []),
        ("Dense", {"name": "dense_1", "units": HIDDEN, "activation": "relu"}, hidden),
    ]
    for seed, (name, count) in enumerate(zip(names, units, strict=True), start=1):
        config = {"name": name, "units": count, "activation": activation}
        layers.append(("Dense", config, random_weights((HIDDEN, count), (count,), seed=seed)))
    return layers


def write(folder: Path, layers: list[Layer], suffix: str = ".h5", ends: int = 2) -> Path:
    """Write a file of Donkeycar, `.h5` of Keras 2 or `.keras`."""
    path = folder / f"pilot{suffix}"
    if suffix == ".h5":
        return write_h5(path, layers, config=functional(layers, 2, ends, SHAPE))
    config = functional(layers, 3, ends, SHAPE)
    config["config"]["layers"].reverse()  # the order of the weights
    return write_keras(path, layers, config=config)


def images(count: int = 50) -> np.ndarray:
    """Return uint8 images [N, H, W, C] of all brightnesses."""
    rng = np.random.default_rng(0)
    return (rng.uniform(0, 256, (count, *SHAPE)) * rng.uniform(0, 1, (count, 1, 1, 3))).astype("u1")


def expected(layers: list[Layer]) -> list[np.ndarray]:
    """Return the outputs before their activation, as Keras computes them of images / 255."""
    (kernel, bias), *ends = (weights for _, _, weights in layers[1:])
    hidden = np.maximum(images().reshape(50, -1) / 255 @ kernel + bias, 0)
    return [hidden @ kernel + bias for kernel, bias in ends]


def answers(converted: ConvertedKeras) -> np.ndarray:
    """Return what the converted network returns for the images."""
    return outputs(network_of(converted), images())


@pytest.mark.parametrize("suffix", [".h5", ".keras"])
@pytest.mark.parametrize("names", [LINEAR, BINS, LINEAR[:1]])
def test_linear_outputs_are_steering_and_throttle(
    names: tuple[str, ...], suffix: str, tmp_path: Path
) -> None:
    layers = donkeycar_layers(names, (1,) * len(names), "linear")
    converted = convert(read_keras(write(tmp_path, layers, suffix, len(names))))
    np.testing.assert_allclose(answers(converted), np.hstack(expected(layers)), atol=1e-5)
    assert converted.scale == (255.0, 0.0)


@pytest.mark.parametrize("suffix", [".h5", ".keras"])
def test_the_largest_bin_is_read_as_donkeycar_does(suffix: str, tmp_path: Path) -> None:
    layers = donkeycar_layers(BINS, (15, 20), "softmax")
    converted = convert(read_keras(write(tmp_path, layers, suffix)), throttle_range=0.5)
    angle, throttle = (bins.argmax(1) for bins in expected(layers))
    assert len(set(angle)) > 2
    wanted = np.stack([angle * (2.0 / 14) - 1, throttle * (0.5 / 20)], 1)
    np.testing.assert_allclose(answers(converted), wanted, atol=1e-6)


def test_outputs_are_in_the_order_of_the_model_not_of_its_layers(tmp_path: Path) -> None:
    layers = donkeycar_layers(LINEAR, (1, 1), "linear")
    config = functional(layers, 2, 2, SHAPE)
    config["config"]["output_layers"] = [["n_outputs0", 0, 0], ["n_outputs1", 0, 0]]
    layers[-2:] = layers[:-3:-1]
    converted = convert(read_keras(write_h5(tmp_path / "pilot.h5", layers, config=config)))
    steering, throttle = expected(layers)[::-1]
    np.testing.assert_allclose(answers(converted), np.hstack([steering, throttle]), atol=1e-5)


def test_a_scale_inside_the_network_is_applied_after_donkeycars(tmp_path: Path) -> None:
    layers = donkeycar_layers(LINEAR, (1, 1), "linear")
    layers.insert(0, ("Rescaling", {"scale": 2.0, "offset": -1.0}, []))
    assert convert(read_keras(write(tmp_path, layers))).scale == (127.5, 1.0)


def test_a_first_normalization_of_pixels_is_of_versions_that_did_not_scale(tmp_path: Path) -> None:
    layers = donkeycar_layers(LINEAR, (1, 1), "linear")
    arrays = [np.ones(3), np.zeros(3), np.full(3, 120.0), np.full(3, 900.0)]
    layers.insert(0, ("BatchNormalization", {"epsilon": 1e-3}, arrays))
    assert convert(read_keras(write(tmp_path, layers))).scale == (1.0, 0.0)


def test_outputs_of_unlike_activation_are_refused(tmp_path: Path) -> None:
    layers = donkeycar_layers(BINS, (15, 1), "softmax")
    layers[-1][1]["activation"] = "relu"
    with pytest.raises(InputError, match=r"pilot\.h5: .*angle_out, throttle_out .*softmax, relu"):
        read_keras(write(tmp_path, layers))


@pytest.mark.parametrize("arrays", [[], [np.zeros((HIDDEN, 0)), np.zeros(0)], [np.zeros(1)] * 2])
def test_outputs_without_weights_are_refused(arrays: list[np.ndarray], tmp_path: Path) -> None:
    layers = donkeycar_layers(BINS, (15, 20), "softmax")
    layers[-1] = (*layers[-1][:2], arrays)
    with pytest.raises(InputError, match=r"pilot\.h5: .*throttle_out"):
        read_keras(write(tmp_path, layers))


def test_other_networks_of_two_outputs_are_named_by_the_user(tmp_path: Path) -> None:
    model = read_keras(write(tmp_path, donkeycar_layers(("speed", "turn"), (1, 1), "linear")))
    with pytest.raises(InputError, match="outputs="):
        convert(model, scale=(255.0, 0.0))
    converted = convert(model, scale=(255.0, 0.0), outputs=["throttle", "steering"])
    assert converted.layers[-1] == {"layer": "Select", "columns": [1, 0]}


def test_a_network_of_bins_can_be_trained_further(tmp_path: Path) -> None:
    converted = convert(read_keras(write(tmp_path, donkeycar_layers(BINS, (15, 20), "softmax"))))
    network = network_of(converted).train()
    network(torch.from_numpy(images()).permute(0, 3, 1, 2)).square().sum().backward()
    assert all(param.grad is not None and param.grad.abs().sum() for param in network.parameters())
