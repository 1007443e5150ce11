"""`drivezoo search`: its files, the replay of the mildest failure, and its errors."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from PIL import Image
from rich.console import Console

from simulator.weather import read_weather
from tests.zoo.commands import only_line, run
from tests.zoo.written_checkpoints import write_constant
from zoo.base.command_keys import read_options
from zoo.drives.drive_log import read_drive
from zoo.evaluate.__main__ import evaluate_or_replay as evaluate
from zoo.search.search_options import SearchOptions
from zoo.search.search_report import search_and_report
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

SHORT = ("length=60", "speed=25", "quality=simple", "cells=4")


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a checkpoint of random weights, whose steering depends on every frame."""
    path = write_constant(tmp_path_factory.mktemp("search") / "best.ckpt", 0.1)
    state = torch.load(path, weights_only=False)
    weight = state["state_dict"]["network.head.weight"]
    weight.copy_(0.3 * torch.randn(weight.shape, generator=torch.Generator().manual_seed(0)))
    torch.save(state, path)
    return path


def test_the_mildest_failure_replays_to_the_frame(
    checkpoint: Path, tmp_path: Path, console: Console
) -> None:
    found = tmp_path / "found=1"
    files = (f"out={found}", f"table={tmp_path / 'features.csv'}")
    options = read_options(SearchOptions, [*SHORT, "budget=4", "workers=1", *files])
    result = search_and_report(str(checkpoint), options, console)
    with (tmp_path / "features.csv").open() as table:
        rows = {one["feature"]: one for one in csv.DictReader(table)}
    assert set(rows) == set(result["features"])
    for name, one in rows.items():
        assert float(one["usual"]) == result["features"][name]["usual"]
    assert json.loads((found / "search.json").read_text()) == json.loads(json.dumps(result))
    with Image.open(found / "map.png") as image:
        assert min(image.size) > 300
    assert result["failed"] == sum(one["failed"] for one in result["drives"]) > 0
    mildest = result["drives"][result["mildest"]["drive"]]
    assert float(rows["bend"]["mildest"]) == mildest["features"]["bend"]
    failures = [one["distance_to_usual"] for one in result["drives"] if one["failed"]]
    assert mildest["distance_to_usual"] == min(failures)

    program, name, *arguments = result["mildest"]["command"]
    assert (program, name) == ("drivezoo", "evaluate")
    evaluate([*arguments, "workers=1", f"out={tmp_path / 'again'}"])
    again = read_drive(tmp_path / "again" / "mildest-0")
    file = found / "mildest.yaml"
    scenario = Scenario(
        road=yaml.safe_load(file.read_text()),
        weather=read_weather(mildest["weather"]),
        speed=options.speed,
        quality=options.quality,
    )
    (first,) = all_drives(str(checkpoint), [scenario], first_only=True)
    frames = len(first)
    assert first.intervention[-1]
    assert not first.intervention[:-1].any()
    assert np.std(first.steering) > 0, "the steering depends on no frame"
    assert again.time_s[frames - 1] == pytest.approx(mildest["time_s"], abs=1e-3)
    for name in ("time_s", "steering", "throttle", "speed_mph", "cross_track_m", "intervention"):
        replayed, searched = getattr(again, name)[:frames], getattr(first, name)
        np.testing.assert_allclose(replayed, searched, atol=1e-5, err_msg=name)


@pytest.mark.slow
def test_the_search_is_the_same_for_every_number_of_workers(
    checkpoint: Path, tmp_path: Path, console: Console
) -> None:
    drives = []
    for workers in (1, 2):
        given = [*SHORT, "budget=10", f"workers={workers}", f"out={tmp_path / str(workers)}"]
        options = read_options(SearchOptions, given)
        drives.append(search_and_report(str(checkpoint), options, console)["drives"])
    assert drives[0] == drives[1]


@pytest.mark.parametrize(
    ("given", "key", "remedy"),
    [
        ("family=alpin", "alpin", "available"),
        ("x=bent", "x=bent", "bend"),
        ("x=width", "y=width", "another"),
        ("weather=random", "weather=random", "vary"),
        ("weather={fgo: 1}", "fgo", "fog"),
        ("quality=best", "quality=best", "simple"),
    ],
)
def test_a_wrong_option_is_named_in_one_line(
    given: str, key: str, remedy: str, checkpoint: Path, tmp_path: Path
) -> None:
    result = run(tmp_path, str(checkpoint), given, module="zoo.search")
    assert result.returncode == 2
    assert key in only_line(result)
    assert remedy in only_line(result)


def test_a_feature_of_days_needs_days(checkpoint: Path, tmp_path: Path) -> None:
    result = run(tmp_path, str(checkpoint), "weather=clear", "x=fog", module="zoo.search")
    assert "x=fog: no such feature" in only_line(result)


def test_a_used_folder_is_refused(checkpoint: Path, tmp_path: Path) -> None:
    (tmp_path / "kept.txt").write_text("kept")
    result = run(tmp_path, str(checkpoint), f"out={tmp_path}", module="zoo.search")
    assert result.returncode == 1
    assert "out=" in only_line(result)
    assert [one.name for one in tmp_path.iterdir()] == ["kept.txt"]
