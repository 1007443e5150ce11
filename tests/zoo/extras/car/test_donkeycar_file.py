"""Files for Donkeycar: they steer as their checkpoint, with a bounded throttle."""

import json
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from datamodules.view import View
from tests.recordings import Written
from tests.slow_members import slow
from tests.zoo.command_runs import only_line, run_here, succeed
from zoo.base.console_script import place_of
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.extras.car.donkeycar_file import (
    bounded,
    donkeycar_bytes,
    donkeycar_policy,
    inferred_throttle,
)
from zoo.models.commaai import CommaAi
from zoo.models.lenet import LeNet
from zoo.models.pilotnet import PilotNet

FRAME = (120, 160)
COLOURS = ("yuv", "rgb", "bgr", "gray", "yuv_old")
needs_reader = pytest.mark.skipif(not place_of("import"), reason="an extra reads Keras' files")


def random_checkpoint(view: View, kind: type[torch.nn.Module] = LeNet, **settings) -> Checkpoint:
    """Return a checkpoint of a network with random weights."""
    torch.manual_seed(0)
    height, width, channels = view.shape
    return Checkpoint(kind((channels, height, width), **settings).eval(), view, {"model": {}}, {})


def pictures(frame: tuple[int, int] = FRAME) -> list[np.ndarray]:
    """Return smooth frames, uint8 [H, W, 3]."""
    rng = np.random.default_rng(0)
    small = rng.integers(0, 256, (8, 6, 8, 3), np.uint8)
    return [cv2.resize(image, frame[::-1], interpolation=cv2.INTER_CUBIC) for image in small]


def difference(checkpoint: Checkpoint, folder: Path) -> float:
    """Return the largest difference of the written file's steering, relative to its spread."""
    path = folder / "pilot.h5"
    path.write_bytes(donkeycar_bytes(checkpoint)[0])
    both = (CheckpointPolicy(checkpoint), donkeycar_policy(checkpoint, path))
    ours, theirs = (
        np.array([policy(frame, 0.0).steering for frame in pictures(checkpoint.view.frame)])
        for policy in both
    )
    assert ours.std() > 0
    return float(np.abs(ours - theirs).max() / ours.std())


@needs_reader
@pytest.mark.parametrize("kind", [LeNet, PilotNet])
def test_layers_and_crop_are_exact(kind: type[torch.nn.Module], tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), "rgb", None, frame=FRAME), kind)
    assert difference(checkpoint, tmp_path) < 1e-3


@needs_reader
@pytest.mark.parametrize(
    ("resize", "colour"),
    [
        *(("area", colour) for colour in COLOURS),
        ("linear_first", "yuv"),
        *slow(*(("linear_first", colour) for colour in COLOURS[1:])),
    ],
)
def test_colour_and_size_differ_by_rounding_only(colour: str, resize: str, tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), colour, (32, 64), resize, FRAME))
    assert difference(checkpoint, tmp_path) < 0.1


@needs_reader
@pytest.mark.parametrize("write", [2, 3])
def test_pure_colours_are_limited_as_opencvs(write: int, tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), "yuv", (32, 64), frame=FRAME))
    path = tmp_path / ("pilot.h5" if write == 2 else "pilot.keras")
    path.write_bytes(donkeycar_bytes(checkpoint, write)[0])
    policies = CheckpointPolicy(checkpoint), donkeycar_policy(checkpoint, path)
    for colour in ((255, 0, 0), (0, 255, 255)):
        frame = np.full((*FRAME, 3), colour, np.uint8)
        ours, theirs = (policy(frame, 0.0).steering for policy in policies)
        assert theirs == pytest.approx(ours, abs=5e-4)


def test_donkeycars_own_throttle_is_that_of_its_formula() -> None:
    assert inferred_throttle([-1.0, 0.0, 1.0]) == pytest.approx([1.0, 0.7538, 0.5565], abs=1e-4)


@needs_reader
def test_the_command_prints_the_throttle_and_what_to_set(recorded: Written, tmp_path: Path) -> None:
    words = ("pilotnet", f"frames={recorded.folder}", "to=donkeycar", "out=pilot.h5")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.export"))
    low, high = re.search(r"Throttle: ([\d.]+) to ([\d.]+) over", printed).groups()
    assert 0.5 < float(low) <= float(high) <= 1
    assert "throttle=0.2" in printed
    words = (*words, "throttle=0.15", "overwrite=true")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.export"))
    assert "Throttle: 0.15 to 0.15" in printed
    for text in ("IMAGE_W = 320", "IMAGE_H = 160", "--model pilot.h5 --type linear"):
        assert text in printed


def test_a_throttle_that_cannot_be_is_refused(tmp_path: Path) -> None:
    result = run_here(tmp_path, "pilotnet", "throttle=1.5", module="zoo.commands.export")
    assert "drivezoo export: throttle" in only_line(result, 2)
    assert not [*tmp_path.iterdir()]


RGB = View((0, 0), "rgb", (66, 200))
SPEED = random_checkpoint(RGB, PilotNet, speed=True)


def with_elu(shape: tuple[int, int, int], before: Sequence = (), alpha: float = 1.0) -> nn.Module:
    return nn.Sequential(nn.Conv2d(shape[0], 4, 3), *before, nn.ELU(alpha))


@pytest.mark.parametrize(
    ("checkpoint", "words"),
    [
        (random_checkpoint(View((60, 40), "hsv_s", (32, 64))), "colour=hsv_s"),
        (random_checkpoint(View((0, 0), "rgb", (66, 200), "blur_linear")), "resize=blur_linear"),
        (SPEED, "PilotNet takes more than"),
        (bounded(SPEED, 0.2), "PilotNet takes more than"),
        (random_checkpoint(RGB, CommaAi, width=0.25), "CommaAi: .* model=lenet or nvidia,"),
        (random_checkpoint(RGB, with_elu, alpha=0.3), "its layer ELU"),
        (random_checkpoint(RGB, with_elu, before=[nn.ReLU()]), "its layer ELU"),
    ],
)
def test_what_donkeycar_cannot_compute_is_refused(checkpoint: Checkpoint, words: str) -> None:
    with pytest.raises(InputError, match=words):
        donkeycar_bytes(checkpoint)


@needs_reader
@pytest.mark.parametrize("resize", ["area", "linear", "linear_first"])
def test_a_keras_3_file_steers_as_that_of_keras_2(resize: str, tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), "yuv", (32, 64), resize, FRAME))
    steering = []
    for keras, name in ((2, "pilot.h5"), (3, "pilot.keras")):
        (tmp_path / name).write_bytes(donkeycar_bytes(checkpoint, keras)[0])
        policy = donkeycar_policy(checkpoint, tmp_path / name)
        steering.append([policy(frame, 0.0).steering for frame in pictures()])
    assert np.ptp(steering[0]) > 0
    np.testing.assert_allclose(steering[1], steering[0], atol=1e-4 * np.ptp(steering[0]))


def test_a_keras_3_file_has_keras_three_parts(tmp_path: Path) -> None:
    checkpoint = random_checkpoint(View((40, 20), "rgb", (32, 64), frame=FRAME))
    path = tmp_path / "pilot.keras"
    path.write_bytes(donkeycar_bytes(checkpoint, keras=3)[0])
    with zipfile.ZipFile(path) as archive:
        assert archive.namelist() == ["metadata.json", "config.json", "model.weights.h5"]
        config = json.loads(archive.read("config.json"))
    layers = config["config"]["layers"]
    assert {layer["module"] for layer in layers} == {"keras.layers"}
    (inputs,) = layers[1]["inbound_nodes"][0]["args"]
    assert inputs["config"]["keras_history"] == ["img_in", 0, 0]


def test_a_view_that_grows_is_refused_by_keras_3() -> None:
    checkpoint = random_checkpoint(View((0, 0), "rgb", (240, 64), "area", FRAME))
    with pytest.raises(InputError, match=r"model\.resize=linear"):
        donkeycar_bytes(checkpoint, keras=3)
