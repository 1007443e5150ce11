"""Checkpoints exported for Donkeycar: a Keras 2 file that computes the same from a whole frame."""

import json
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import torch

from datamodules.view import View
from tests.recordings import Written
from tests.zoo.commands import only_line, run, succeed
from tests.zoo.keras.test_donkeycar import BINS, LINEAR, SHAPE, donkeycar_layers
from tests.zoo.keras.test_donkeycar import write as write_donkeycar
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.policy import CheckpointPolicy
from zoo.export.donkeycar_file import donkeycar_bytes, donkeycar_policy
from zoo.keras.keras_file import read_keras
from zoo.keras.keras_layers import convert
from zoo.models.commaai import CommaAi
from zoo.models.lenet import LeNet
from zoo.models.pilotnet import PilotNet
from zoo.models.sequential import Sequential

FRAME = (120, 160)


def random_checkpoint(view: View, kind: type[torch.nn.Module] = LeNet, **settings) -> Checkpoint:
    """Return a checkpoint of a network with random weights."""
    torch.manual_seed(0)
    height, width, channels = view.shape
    return Checkpoint(kind((channels, height, width), **settings).eval(), view, {"model": {}}, {})


def frames(frame: tuple[int, int] = FRAME) -> list[np.ndarray]:
    """Return smooth frames, uint8 [H, W, 3]."""
    rng = np.random.default_rng(0)
    small = rng.integers(0, 256, (8, 6, 8, 3), np.uint8)
    return [cv2.resize(one, frame[::-1], interpolation=cv2.INTER_CUBIC) for one in small]


def difference(checkpoint: Checkpoint, folder: Path) -> float:
    """Return the largest difference of the written file's steering, relative to its spread."""
    path = folder / "pilot.h5"
    path.write_bytes(donkeycar_bytes(checkpoint)[0])
    both = (CheckpointPolicy(checkpoint), donkeycar_policy(checkpoint, path))
    ours, theirs = (
        np.array([one(frame, 0.0).steering for frame in frames(checkpoint.view.frame)])
        for one in both
    )
    assert ours.std() > 0
    return float(np.abs(ours - theirs).max() / ours.std())


@pytest.mark.parametrize("kind", [LeNet, PilotNet])
def test_layers_and_crop_are_exact(kind: type[torch.nn.Module], tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), "rgb", None, frame=FRAME), kind)
    assert difference(checkpoint, tmp_path) < 1e-3


@pytest.mark.parametrize("colour", ["rgb", "bgr", "gray", "yuv", "yuv_old"])
@pytest.mark.parametrize("resize", ["area", "linear_first"])
def test_colour_and_size_differ_by_rounding_only(colour: str, resize: str, tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), colour, (32, 64), resize, FRAME))
    assert difference(checkpoint, tmp_path) < 0.1


@pytest.mark.parametrize(
    ("names", "units", "activation", "model_type"),
    [
        (LINEAR, (1, 1), "linear", "linear"),
        (BINS, (15, 20), "softmax", "categorical"),
        (LINEAR[:1], (1,), "linear", "inferred"),
    ],
)
def test_a_network_of_donkeycar_returns_as_it_came(
    names: tuple[str, ...],
    units: tuple[int, ...],
    activation: str,
    model_type: str,
    tmp_path: Path,
) -> None:
    layers = donkeycar_layers(names, units, activation)
    read = convert(read_keras(write_donkeycar(tmp_path, layers, ends=len(names))))
    checkpoint = random_checkpoint(
        View((0, 0), "rgb", None, frame=SHAPE[:2]),
        Sequential,
        layers=read.layers,
        scale=read.scale,
    )
    checkpoint.network.load_state_dict(read.state)
    contents, found = donkeycar_bytes(checkpoint)
    assert found == model_type
    (tmp_path / "back.h5").write_bytes(contents)
    with h5py.File(tmp_path / "back.h5") as file:
        config = json.loads(file.attrs["model_config"])["config"]
        assert [name for name, *_ in config["output_layers"]] == list(names)
        for (name, _, (kernel, bias)), end in zip(layers[-len(names) :], names, strict=True):
            assert name == "Dense"
            group = file["model_weights"][end]
            found_kernel, found_bias = (group[path] for path in group.attrs["weight_names"])
            np.testing.assert_array_equal(found_kernel, kernel)
            np.testing.assert_array_equal(found_bias, bias)


@pytest.mark.parametrize(
    ("checkpoint", "words"),
    [
        (random_checkpoint(View((60, 40), "hsv_s", (32, 64))), "colour=hsv_s"),
        (random_checkpoint(View((0, 0), "rgb", (66, 200), "blur_linear")), "resize=blur_linear"),
        (random_checkpoint(View((0, 0), "rgb", (66, 200)), PilotNet, speed=True), "more than"),
        (random_checkpoint(View((0, 0), "rgb", (66, 200)), CommaAi, width=0.25), "CommaAi"),
    ],
)
def test_what_donkeycar_cannot_compute_is_refused(checkpoint: Checkpoint, words: str) -> None:
    with pytest.raises(InputError, match=words):
        donkeycar_bytes(checkpoint)


def test_the_command_prints_what_to_set_in_donkeycar(recorded: Written, tmp_path: Path) -> None:
    write_donkeycar(tmp_path, donkeycar_layers(LINEAR, (1, 1), "linear"))
    assert run(tmp_path, "pilot.h5", module="zoo.import").returncode == 0
    arguments = ("pilot.ckpt", "out=back.h5", f"frames={recorded.folder}")
    printed = succeed(run(tmp_path, *arguments, module="zoo.export"))
    for text in ("IMAGE_W = 16", "IMAGE_H = 12", "--model back.h5 --type linear"):
        assert text in printed
    assert run(tmp_path, "back.h5", "out=again.ckpt", module="zoo.import").returncode == 0


def test_a_refused_export_leaves_nothing(tmp_path: Path) -> None:
    write_constant(tmp_path / "constant.ckpt", 0.1)
    line = only_line(run(tmp_path, "constant.ckpt", "out=pilot.h5", module="zoo.export"))
    assert "hsv_s" in line
    assert not list(tmp_path.glob("*pilot.h5*"))
