"""A run folder and a checkpoint of version 0.1.0, from before classes moved to other modules."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from simulator.__main__ import simulator
from tests.zoo.trainings import zoo_here
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.policy import load_policy
from zoo.leaderboard.ranking import read_runs
from zoo.report.write_up import write_report
from zoo.runs.config_files import load_config, read_config_file

WRITTEN = Path(__file__).with_name("run_of_0_1_0")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Copy the run folder."""
    return Path(shutil.copytree(WRITTEN, tmp_path / "run"))


def test_its_checkpoint_drives(run: Path) -> None:
    frame = np.full((160, 320, 3), 128, np.uint8)
    steering, _ = load_policy(run)(frame, 10.0)
    assert -1 <= steering <= 1


def test_classes_that_moved_have_their_current_names(run: Path) -> None:
    moved = "zoo.callbacks.training_images.FedBatch"
    assert "zoo.callbacks.pictures" in (run / ".hydra" / "config.yaml").read_text()
    for config in (load_config(run), read_config_file(run), load_checkpoint(run).config):
        assert config["callbacks"]["fed_batch"]["_target_"] == moved


def test_it_is_ranked_and_reported(run: Path) -> None:
    found, unranked = read_runs([run])
    assert [one.folder for one in found] == [run]
    assert not unranked
    page = write_report(run).read_text()
    assert "could not be written" not in page


@pytest.mark.slow
def test_its_training_resumes(run: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(run.parent)
    arguments = ["out=recording", "laps=0.1", "speed=15", "seed=3", "relative=true"]
    simulator(["record", *arguments])
    more = f"resume={run}", "trainer.max_epochs=3", "data.cache=cache"
    ended = zoo_here(monkeypatch, run.parent, *more)
    assert ended == 0, capsys.readouterr().err
    assert json.loads((run / "metrics.json").read_text())["epochs"] == 3
