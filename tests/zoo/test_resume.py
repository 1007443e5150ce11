"""Resuming a run: finished, moved, or trained by another process."""

import json
import shutil
from pathlib import Path

import pytest
import torch

from tests.recordings import Written
from tests.zoo.commands import run

SMALL = (
    "model=tiny",
    "data.crop=[50,0]",
    "data.block_s=0.5",
    "data.gap_s=0.1",
    "data.batch_size=16",
    "callbacks=published",
    "score=none",
)


def weights(run_folder: Path, name: str) -> dict[str, torch.Tensor]:
    return torch.load(run_folder / "checkpoints" / f"{name}.ckpt", weights_only=True)["state_dict"]


def metrics(run_folder: Path) -> dict:
    return json.loads((run_folder / "metrics.json").read_text())


def test_a_moved_run_ends_with_the_best_checkpoint_of_an_unbroken_one(
    recorded: Written, tmp_path: Path
) -> None:
    # The greatest error counts as best, so that the best epoch is the first, before the move.
    overrides = (*SMALL, f"data.root={recorded.folder}", "callbacks.best.mode=max")
    for folder, epochs in (("whole", 4), ("old", 2)):
        done = run(tmp_path, *overrides, f"trainer.max_epochs={epochs}", f"hydra.run.dir={folder}")
        assert done.returncode == 0, done.stderr
    shutil.move(tmp_path / "old", tmp_path / "new")

    resumed = run(tmp_path, "resume=new", "trainer.max_epochs=4")

    assert resumed.returncode == 0, resumed.stderr
    assert resumed.stderr == ""
    assert metrics(tmp_path / "whole")["best_epoch"] == 1, "the setting shows nothing"
    assert metrics(tmp_path / "new")["best_epoch"] == 1
    for name in ("best", "last"):
        ours, theirs = weights(tmp_path / "new", name), weights(tmp_path / "whole", name)
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)
    assert not (tmp_path / "old").exists()
