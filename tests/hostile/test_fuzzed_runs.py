"""Damaged run folders, drives, sweeps and suites, by the hundred: read, or refused in one line."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import strategies as st

from tests.hostile.mutations import FEW_AND_MANY, mutated_bytes, mutated_json, read_damaged
from tests.hostile.test_damaged_files import write_drive
from tests.zoo.sweeps import write_run
from zoo.benchmark.suite import read_suite
from zoo.drives.drive_log import read_drive
from zoo.leaderboard.ranking import rank
from zoo.leaderboard.scored import load_run, read_scored
from zoo.runs.status import read_status_file
from zoo.sweep.sweep_record import new_record, read_record, write_record


def read_ranked(run: Path) -> object:
    """Return a run as the leaderboard shows it."""
    read_status_file(run)
    load_run(run)
    runs, _ = read_scored([run])
    return rank(runs)


def damaged(path: Path) -> st.SearchStrategy[bytes]:
    """Return a strategy of damaged files: of a JSON's or YAML's values, or of bytes."""
    if path.suffix == ".csv":
        return mutated_bytes(path.read_bytes())
    found = yaml.safe_load(path.read_text())
    return mutated_json(found) | mutated_bytes(path.read_bytes())


@FEW_AND_MANY
@pytest.mark.parametrize(
    "file",
    [
        "metrics.json",
        "status.json",
        "metrics.csv",
        ".hydra/config.yaml",
        ".hydra/overrides.yaml",
        ".hydra/hydra.yaml",
    ],
)
def test_damaged_run_folders(file: str, tmp_path: Path, count: int) -> None:
    run = write_run(tmp_path / "run", 0.9, start_seeds=3)
    path = run / file
    if not path.exists():
        path.write_text("epoch,step,val/mse,train/loss\n0,1,0.5,\n0,1,,0.25\n1,2,0.4,\n")
    read_damaged(damaged(path), lambda _: read_ranked(run), path, count)


@FEW_AND_MANY
@pytest.mark.parametrize("file", ["drive.json", "drive.csv"])
def test_damaged_drives(file: str, tmp_path: Path, count: int) -> None:
    path = write_drive(tmp_path / "drive") / file
    read_damaged(damaged(path), lambda one: read_drive(one.parent), path, count)


def sweep(path: Path) -> object:
    return read_record(path.parent)


def suite(path: Path) -> object:
    return read_suite(str(path))


@FEW_AND_MANY
@pytest.mark.parametrize("read", [sweep, suite])
def test_damaged_sweeps_and_suites(
    read: Callable[[Path], object], tmp_path: Path, count: int
) -> None:
    if read is sweep:
        write_record(tmp_path, new_record(["seed=1,2"]))
        path = tmp_path / "sweep.json"
    else:
        path = tmp_path / "mine.yaml"
        drives = {"tracks": ["lake", "alpine:1"], "seeds": [0, 1], "laps": 0.5, "speed_mph": 15}
        path.write_text(json.dumps({"drives": [drives], "weather": ["clear", {"fog": 0.4}]}))
    read_damaged(damaged(path), read, path, count)
