"""Donkeycar's pilot from `drivezoo new donkeycar`: it steers as the checkpoint does."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch

from datamodules.view import CONVERSIONS, RESIZES, View
from tests.zoo.models.test_models_command import build
from zoo.base.rig import MPS_PER_MPH
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.commands.new import write_part

FRAMES = np.random.default_rng(0).integers(0, 256, (3, 120, 160, 3), np.uint8)


@pytest.fixture
def part(tmp_path: Path) -> ModuleType:
    return imported_part(tmp_path)


def imported_part(folder: Path) -> ModuleType:
    """Write and import the part in an empty folder."""
    (path,), _ = write_part("donkeycar", "my_pilot", folder)
    spec = importlib.util.spec_from_file_location("my_pilot", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def checkpoint_of(name: str, *keys: str, **data: object) -> Checkpoint:
    """Return an untrained network for frames of 160 x 120 pixels."""
    torch.manual_seed(1)
    network, view = build(name, *keys)
    view = replace(view, frame=FRAMES.shape[1:3])
    return Checkpoint(network.eval(), view, {"model": {"name": name}}, {"rows": 3, **data})


def onnx_part(part: ModuleType, checkpoint: Checkpoint, folder: Path) -> object:
    pytest.importorskip("onnxruntime")
    (folder / "my_pilot.onnx").write_bytes(onnx_bytes(checkpoint))
    return part.MyPilot(str(folder / "my_pilot.onnx"), throttle=0.3)


@pytest.mark.parametrize("name", ["tiny63", "nvidia_gaussian", "nvidia_speed"])
def test_an_onnx_file_steers_as_its_checkpoint(name: str, part: ModuleType, tmp_path: Path) -> None:
    checkpoint = checkpoint_of(name)
    pilot, policy = onnx_part(part, checkpoint, tmp_path), CheckpointPolicy(checkpoint)
    for frame in (*FRAMES, FRAMES[0, ::2, 10:]):  # the last one has another size
        command = policy(frame, 3.0)
        throttle = 0.3 if command.throttle is None else command.throttle
        expected = pytest.approx((command.steering, throttle), abs=1e-5)
        assert pilot.run(frame, 3 * MPS_PER_MPH) == expected
    pilot.shutdown()


@pytest.mark.parametrize("resize", RESIZES)
@pytest.mark.parametrize("colour", CONVERSIONS)
def test_it_sees_what_the_training_saw(colour: str, resize: str, part: ModuleType) -> None:
    view = View((60, 25), colour, (32, 64), resize, (120, 160))
    pytest.importorskip("onnxruntime")
    metadata = {"data": {}, "predicts_spread": False, "view": view.to_dict()}
    shape = ["batch", view.shape[2], *view.shape[:2]]
    given = [SimpleNamespace(name="images", shape=shape)]
    about = SimpleNamespace(custom_metadata_map={"drivezoo": json.dumps(metadata)})
    session = SimpleNamespace(get_inputs=lambda: given, get_modelmeta=lambda: about)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("onnxruntime.InferenceSession", lambda *_, **__: session)
        network = part.OnnxNetwork(Path("my_pilot.onnx"))
    assert (network.seen(FRAMES[0]).reshape(view.shape) == view(FRAMES[0])).all()


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("cnn_gru", {}, "keeps earlier frames"),
        ("lenet", {"curvature_per_m": 0.2}, "data.label=steering"),
    ],
)
def test_a_network_that_it_cannot_run_is_refused(
    name: str, data: dict, words: str, part: ModuleType, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=words):
        onnx_part(part, checkpoint_of(name, **data), tmp_path)
