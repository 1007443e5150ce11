"""Networks of Donkeycar that were imported are exported for Donkeycar: they steer the same."""

import json
from importlib import import_module
from pathlib import Path

import h5py
import numpy as np
import pytest

from datamodules.view import View
from tests.zoo.extras.keras.test_donkeycar import BINS, LINEAR, SHAPE, donkeycar_layers
from tests.zoo.extras.keras.test_donkeycar import write as write_donkeycar
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.network_files import read_network
from zoo.extras.keras.keras_file import read_keras
from zoo.extras.keras.keras_layers import convert

donkeycar_file = pytest.importorskip("zoo.extras.car.donkeycar_file", reason="an extra writes it")

UNITS = {LINEAR: (1, 1), BINS: (15, 20), LINEAR[:1]: (1,)}
TYPES = {LINEAR: "linear", BINS: "categorical", LINEAR[:1]: "inferred"}


def imported(folder: Path, names: list[str], layers: list) -> Checkpoint:
    """Return a checkpoint of a written network of Donkeycar; the last bin's throttle is 0.5."""
    network = read_network(write_donkeycar(folder, layers, ends=len(names)))
    for bins in donkeycar_file.bins_of(network):
        bins.groups[1] = (20, 0.0, 0.5 / 20)
    return Checkpoint(network, View((0, 0), "rgb", None, frame=SHAPE[:2]), {"model": {}}, {})


@pytest.mark.parametrize("names", TYPES)
def test_a_network_of_donkeycar_returns_as_it_came(names: tuple[str, ...], tmp_path: Path) -> None:
    layers = donkeycar_layers(names, UNITS[names], "softmax" if names == BINS else "linear")
    checkpoint = imported(tmp_path, names, layers)
    contents, model_type = donkeycar_file.donkeycar_bytes(checkpoint)
    assert model_type == TYPES[names]
    (tmp_path / "back.h5").write_bytes(contents)
    back = donkeycar_file.donkeycar_policy(checkpoint, tmp_path / "back.h5")
    expected = commands_of(CheckpointPolicy(checkpoint))
    np.testing.assert_allclose(commands_of(back), expected, atol=1e-6)
    with h5py.File(tmp_path / "back.h5") as file:
        config = json.loads(file.attrs["model_config"])["config"]
        assert [name for name, *_ in config["output_layers"]] == list(names)
        for (name, _, (kernel, bias)), end in zip(layers[-len(names) :], names, strict=True):
            assert name == "Dense"
            group = file["model_weights"][end]
            found_kernel, found_bias = (group[path] for path in group.attrs["weight_names"])
            np.testing.assert_array_equal(found_kernel, kernel)
            np.testing.assert_array_equal(found_bias, bias)


def commands_of(policy: CheckpointPolicy) -> np.ndarray:
    """Return steering and throttle for some frames, [frames, 2]."""
    frames = np.random.default_rng(0).integers(0, 256, (8, *policy.view.frame, 3), np.uint8)
    return np.array([tuple(policy(frame, 0.0)) for frame in frames], float)


@pytest.mark.parametrize(
    ("names", "activation", "most"),
    [
        (LINEAR, "linear", 0.02),
        (LINEAR, "tanh", 0.02),
        (LINEAR, "linear", 1.0),
        (BINS, "softmax", 0.2),
        (LINEAR[:1], "linear", 0.2),
    ],
)
def test_a_throttle_is_bounded(names: tuple, activation: str, most: float, tmp_path: Path) -> None:
    free = imported(tmp_path, names, donkeycar_layers(names, UNITS[names], activation))
    bounded = donkeycar_file.bounded(free, most)
    contents, kind = donkeycar_file.donkeycar_bytes(bounded)
    (tmp_path / "bound.h5").write_bytes(contents)
    written = donkeycar_file.donkeycar_policy(bounded, tmp_path / "bound.h5")
    commands, before = commands_of(written), commands_of(CheckpointPolicy(free))
    np.testing.assert_allclose(commands[:, 0], before[:, 0], atol=1e-6)
    assert commands[:, 1].max() <= most + 1e-6
    if names == LINEAR:
        np.testing.assert_allclose(commands[:, 1], before[:, 1].clip(max=most), atol=1e-6)
    if names == LINEAR[:1]:
        assert kind == "linear"
        np.testing.assert_allclose(commands[:, 1], most)


def test_layers_after_bins_are_refused_also_with_a_bound(tmp_path: Path) -> None:
    path = write_donkeycar(tmp_path, donkeycar_layers(BINS, UNITS[BINS], "softmax"), ends=2)
    network = convert(read_keras(path), line=(1.1, 0.0)).network.eval()
    free = Checkpoint(network, View((0, 0), "rgb", None, frame=SHAPE[:2]), {"model": {}}, {})
    for checkpoint in (free, donkeycar_file.bounded(free, 0.2)):
        with pytest.raises(InputError, match=r"last layer .*; name another kind of file"):
            donkeycar_file.donkeycar_bytes(checkpoint)


@pytest.mark.parametrize("names", TYPES)
def test_a_file_of_litert_torch_steers_the_same(names: tuple[str, ...], tmp_path: Path) -> None:
    pytest.importorskip("litert_torch", reason="the converter is optional")
    checkpoint = imported(tmp_path, names, donkeycar_layers(names, UNITS[names], "linear"))
    path = tmp_path / "pilot.tflite"
    exported = import_module("zoo.extras.car.tflite_export").TfliteFile(checkpoint, path)
    path.write_bytes(exported.files("")[".tflite"])
    assert exported.hints()[0].endswith(f"--type tflite_{TYPES[names]}")
    actual, expected = commands_of(exported.policy(path)), commands_of(CheckpointPolicy(checkpoint))
    np.testing.assert_allclose(actual, expected, atol=1e-5)
