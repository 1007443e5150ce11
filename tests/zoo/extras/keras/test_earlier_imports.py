"""Checkpoints of imported networks that version 0.1 wrote."""

from pathlib import Path

import numpy as np
import torch

from tests.zoo.command_runs import run_here, succeed
from tests.zoo.extras.keras.keras_files import lambda_config, random_weights, write_h5
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.extras.keras.sequential import Sequential
from zoo.runs.saved_config import find_refusals

EARLIER = "zoo.models.sequential.Sequential"
CONVOLUTION = {"filters": 2, "kernel_size": [5, 5], "strides": [4, 4]}
LAYERS = [
    ("Lambda", lambda_config(lambda x: x / 127.5 - 1.0), []),
    ("Conv2D", CONVOLUTION, random_weights((5, 5, 3, 2), (2,))),
    ("Flatten", {}, []),
    ("Dense", {"units": 1}, random_weights((39 * 79 * 2, 1), (1,))),
]


def steering(policy: CheckpointPolicy) -> list[float]:
    frames = np.random.default_rng(0).integers(0, 256, (5, 160, 320, 3), np.uint8)
    return [policy(frame, 9.0).steering for frame in frames]


def test_a_checkpoint_of_version_0_1_drives_the_same(tmp_path: Path) -> None:
    write_h5(tmp_path / "model.h5", LAYERS, shape=(160, 320, 3))
    words = ("model.h5", "colour=rgb", "crop=[0,0]")
    succeed(run_here(tmp_path, *words, module="zoo.extras.keras.import"))
    path, earlier = tmp_path / "model.ckpt", tmp_path / "earlier.ckpt"
    contents = torch.load(path, weights_only=True)
    card = contents["drivezoo"]
    assert "parts" not in card  # as in version 0.1: the extra's code is drivezoo's
    card["config"]["model"]["_target_"] = EARLIER
    torch.save(contents, earlier)
    checkpoint = load_checkpoint(earlier)
    assert type(checkpoint.network) is Sequential
    assert list(find_refusals(checkpoint.config)) == []
    assert steering(load_policy(earlier)) == steering(load_policy(path))
