"""Damaged tracks, runs and drives, by the hundred: read, or refused in one line."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from hypothesis import strategies as st

from tests.hostile.mutations import FEW_AND_MANY, mutated_bytes, mutated_json, read_damaged
from tests.hostile.test_damaged_files import write_drive
from tests.zoo.sweeps import write_run
from zoo.base.errors import InputError
from zoo.driving.drive_log import read_drive
from zoo.results.ranking import rank
from zoo.results.scored import load_run, read_scored
from zoo.results.suite import read_suite
from zoo.runs.status import read_status_file
from zoo.simulator.road_family import draw_road, find_family
from zoo.simulator.track_file import read_track
from zoo.simulator.track_names import track_folder
from zoo.training.sweep_record import new_record, read_record, write_record


def converted(convert: Callable, depth: int) -> Callable[[Path], object]:
    """Return a reader that converts the folder above a file, and removes what was written."""

    def read(path: Path) -> object:
        folder = path.parents[depth]
        out = folder.parent / "out"
        try:
            return convert(folder, out)
        except InputError as error:
            # A file without a usable row is named by its folder.
            name = path.name if str(folder) in str(error) else "no file"
            raise InputError(f"{name}: {error}") from None
        finally:
            assert not [*out.parent.glob(".out*")]
            shutil.rmtree(out, ignore_errors=True)

    return read


@FEW_AND_MANY
def test_damaged_tracks(tmp_path: Path, count: int) -> None:
    text = (track_folder() / "zoo_lake.yaml").read_text()
    path = tmp_path / "mine.yaml"
    small = {"segments": [{"straight": 100}, {"left": 90, "radius": 40, "climb": 1}]}
    small |= {"closed": False, "width": 7, "widths": [[0, 7], [50, 8]], "verge": {"left": "wall"}}
    small |= {"stretches": [{"from": 5, "to": 9, "paving": "cobbles", "left": "rock"}]}
    small |= {"surroundings": {"lakes": [[50, 50, 10]], "trees": 5, "ground": "grass"}}
    damaged = mutated_json(small) | mutated_bytes(text.encode())
    read_damaged(damaged, lambda _: read_track(str(path)), path, count)


@FEW_AND_MANY
def test_damaged_families(tmp_path: Path, count: int) -> None:
    text = find_family("alpine").path.read_text()
    damaged = mutated_json(yaml.safe_load(text)) | mutated_bytes(text.encode())
    path = tmp_path / "mine.yaml"
    read_damaged(damaged, lambda file: draw_road(find_family(str(file)), 17), path, count // 4)


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
    return mutated_json(yaml.safe_load(path.read_text())) | mutated_bytes(path.read_bytes())


@FEW_AND_MANY
@pytest.mark.parametrize(
    "file",
    [
        *("metrics.json", "status.json", "metrics.csv"),
        *(f".hydra/{name}.yaml" for name in ("config", "overrides", "hydra")),
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
    read_damaged(damaged(path), lambda _: read_drive(path.parent), path, count)


@FEW_AND_MANY
def test_damaged_sweeps(tmp_path: Path, count: int) -> None:
    write_record(tmp_path, new_record(["seed=1,2"]))
    path = tmp_path / "sweep.json"
    read_damaged(damaged(path), lambda _: read_record(tmp_path), path, count)


@FEW_AND_MANY
def test_damaged_suites(tmp_path: Path, count: int) -> None:
    path = tmp_path / "mine.yaml"
    drives = {"tracks": ["lake", "alpine:1"], "seeds": [0, 1], "laps": 0.5, "speed_mph": 15}
    path.write_text(json.dumps({"drives": [drives], "weather": ["clear", {"fog": 0.4}]}))
    read_damaged(damaged(path), lambda _: read_suite(str(path)), path, count)
