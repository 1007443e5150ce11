"""`drivezoo search`: the command, the space of a search, and what is drawn from it."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from PIL import Image
from rich.console import Console

from tests.zoo.command_runs import only_line, run_here
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError, StoppedError
from zoo.base.key_values import read_options
from zoo.commands.evaluate import evaluate_or_replay as evaluate
from zoo.driving.drive_log import read_drive
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.extras.research import search_report
from zoo.extras.research.failure_map import Archive, failure_map
from zoo.extras.research.search_options import SearchOptions
from zoo.extras.research.search_report import search_and_report
from zoo.extras.research.search_run import (
    Driven,
    Outcome,
    feature_distance,
    search,
    sparseness,
    usual_features,
)
from zoo.extras.research.search_space import DAYS, Candidate, SearchSpace, weather_text
from zoo.simulator.road_family import find_family
from zoo.simulator.weather import CLEAR, Weather, read_weather

MODULE = "zoo.extras.research.search"
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


def test_the_mildest_failure_replays(checkpoint: Path, tmp_path: Path, console: Console) -> None:
    folder = tmp_path / "found=1"
    files = (f"out={folder}", f"table={tmp_path / 'features.csv'}")
    options = read_options(SearchOptions, [*SHORT, "budget=4", "workers=1", *files])
    result = search_and_report(str(checkpoint), options, console)
    with (tmp_path / "features.csv").open() as table:
        rows = {row["feature"]: row for row in csv.DictReader(table)}
    assert set(rows) == set(result["features"])
    for name, row in rows.items():
        assert float(row["usual"]) == result["features"][name]["usual"]
    assert json.loads((folder / "search.json").read_text()) == json.loads(json.dumps(result))
    with Image.open(folder / "map.png") as image:
        assert min(image.size) > 300
    assert result["failed"] == sum(drive["failed"] for drive in result["drives"]) > 0
    mildest = result["drives"][result["mildest"]["drive"]]
    assert float(rows["bend"]["mildest"]) == mildest["features"]["bend"]
    failures = [drive["distance_to_usual"] for drive in result["drives"] if drive["failed"]]
    assert mildest["distance_to_usual"] == min(failures)

    program, name, *arguments = result["mildest"]["command"]
    assert (program, name) == ("drivezoo", "evaluate")
    evaluate([*arguments, "workers=1", f"out={tmp_path / 'again'}"])
    again = read_drive(tmp_path / "again" / "mildest-0")
    road, weather = (folder / "mildest.yaml").read_text(), read_weather(mildest["weather"])
    setting = {"weather": weather, "speed": options.speed, "quality": options.quality}
    scenario = Scenario(road=yaml.safe_load(road), **setting)
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
def test_workers_do_not_change_a_search(checkpoint: Path, tmp_path: Path, console: Console) -> None:
    drives = []
    for workers in (1, 2):
        given = [*SHORT, "budget=10", f"workers={workers}", f"out={tmp_path / str(workers)}"]
        options = read_options(SearchOptions, given)
        drives.append(search_and_report(str(checkpoint), options, console)["drives"])
    assert drives[0] == drives[1]


@pytest.mark.parametrize(
    ("given", "key", "remedy"),
    [
        (["family=alpin"], "alpin", "available"),
        (["x=bent"], "x=bent", "bend"),
        (["x=width"], "y=width", "another"),
        (["family=bends_1"], "y=width: is 6", "another"),
        (["weather=random"], "weather=random", "vary"),
        (["weather=clear", "x=fog"], "x=fog: no such feature", "bend"),
    ],
)
def test_a_wrong_option_is_named_in_one_line(
    given: list[str], key: str, remedy: str, checkpoint: Path, tmp_path: Path
) -> None:
    line = only_line(run_here(tmp_path, str(checkpoint), *given, module=MODULE), 2)
    assert key in line
    assert remedy in line


def test_a_used_folder_is_refused(checkpoint: Path, tmp_path: Path) -> None:
    (tmp_path / "kept.txt").write_text("kept")
    result = run_here(tmp_path, str(checkpoint), f"out={tmp_path}", module=MODULE)
    assert "out=" in only_line(result, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["kept.txt"]


ALPINE = find_family("alpine")


@pytest.mark.parametrize("name", ["alpine", "country", "lakeside"])
def test_a_road_has_what_was_chosen(name: str) -> None:
    space = SearchSpace(find_family(name), 100.0, None)
    rng = np.random.default_rng(0)
    for share in (0.1, 0.5, 0.9):
        parameters = {key: parameter.at(share) for key, parameter in space.parameters.items()}
        road = space.draw(rng, parameters)
        assert road is not None
        assert not road.track.closed
        assert road.track.length == pytest.approx(100, abs=12)
        assert road.features["bend"] > 0.9 * parameters["radius"]
        assert road.features["width"] >= parameters["width"] - 0.01
        assert road.features["grade"] <= 100 * parameters["grade"] + 0.1
        assert road.features["fog"] == max(round(parameters["fog"], 3), 0)


def test_a_family_that_always_climbs_can_be_searched() -> None:
    space = SearchSpace(ALPINE.model_copy(update={"grade": (0.05, 0.1)}), 100.0, CLEAR)
    low = {key: parameter.low for key, parameter in space.parameters.items()}
    road = space.draw(np.random.default_rng(0), low | {"radius": 30.0})
    assert road.features["grade"] == pytest.approx(5, abs=0.2)


def test_a_fixed_day_is_no_feature() -> None:
    assert set(SearchSpace(ALPINE, 100.0, CLEAR).features) == {"bend", "width", "grade"}
    assert not set(DAYS) & set(SearchSpace(ALPINE, 100.0, CLEAR).parameters)


def test_values_beyond_a_range_are_in_the_outer_cells() -> None:
    grid = Archive("bend", "width", SearchSpace(ALPINE, 100.0, None).features, 4)
    assert grid.cell({"bend": 1.0, "width": 99.0}) == (0, 3)
    bends, widths = grid.edges("bend"), grid.edges("width")
    assert bends[[0, -1]] == pytest.approx(ALPINE.radius)
    for number in range(4):
        inside = {"bend": bends[number] * 1.01, "width": widths[number] + 0.01}
        assert grid.cell(inside) == (number, number)


def test_an_archive_counts_cells() -> None:
    archive = Archive("bend", "width", SearchSpace(ALPINE, 100.0, None).features, 4)
    for failed in (True, False, True):
        archive.add({"bend": 8.0, "width": 5.0}, failed)
    archive.add({"bend": 50.0, "width": 5.0}, False)
    assert (len(archive.driven), len(archive.failed)) == (2, 1)
    assert archive.failed[archive.cell({"bend": 8.0, "width": 5.0})] == 2
    bar = failure_map(archive, [], None, "").axes[1]
    assert [tick.get_text() for tick in bar.get_yticklabels()][:2] == ["0", ">0"]


def test_a_stopped_search_has_the_road_that_it_names(
    checkpoint: Path, tmp_path: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(search_report, "draw_map", stop)
    options = read_options(SearchOptions, [*SHORT, "budget=4", "workers=1", f"out={tmp_path}/s"])
    with pytest.raises(StoppedError, match="what was finished is in"):
        search_and_report(str(checkpoint), options, console)
    command = json.loads((tmp_path / "s" / "search.json").read_text())["mildest"]["command"]
    (track,) = [word for word in command if word.startswith("track=")]
    assert Path(track.partition("=")[2]).is_file()


def test_the_usual_road_is_the_mildest() -> None:
    space = SearchSpace(ALPINE, 100.0, None)
    usual = usual_features(space)
    assert feature_distance(usual, usual, space) == 0
    foggy, foggier = usual | {"fog": 0.3}, usual | {"fog": 0.6}
    near, far = (feature_distance(features, usual, space) for features in (foggy, foggier))
    assert 0 < near < far < 1
    assert sparseness([usual], space) is None
    assert sparseness([usual, foggy, foggier], space) == pytest.approx((far + near + far) / 3)


@pytest.mark.parametrize(
    "weather",
    [CLEAR, Weather(fog=0.123, shadows=False), read_weather("{wet: 1, camera: {pitch_deg: 2.5}}")],
)
def test_a_weathers_text_reads_back(weather: Weather) -> None:
    assert read_weather(weather_text(weather)) == weather


def options_of(*given: str) -> SearchOptions:
    return read_options(SearchOptions, ["length=60", "weather=clear", *given])


def narrow_fails(chosen: list[Candidate]) -> list[Outcome]:
    """Fail on roads narrower than 5.4 m."""
    widths = [
        min(width for _, width in road.content.get("widths", [[0, road.content["width"]]]))
        for road in chosen
    ]
    return [Outcome(width < 5.4, 30.0, 5.0, min(1.0, 5.4 / width), 0) for width in widths]


def searched(options: SearchOptions) -> tuple[list[Driven], Archive]:
    space = options.space()
    archive = options.archive(space)
    batches: list[int] = []
    drives = search(options, space, archive, narrow_fails, lambda d: batches.append(len(d)))
    assert batches == [*range(8, options.budget, 8), options.budget]
    return drives, archive


def test_the_archive_finds_more_failing_cells_than_random_drawing() -> None:
    by_sampler = {
        sampler: sum(
            len(searched(options_of("budget=80", f"sampler={sampler}", f"seed={seed}"))[1].failed)
            for seed in range(2)
        )
        for sampler in ("archive", "random")
    }
    assert by_sampler["archive"] > 1.2 * by_sampler["random"]


@pytest.mark.parametrize("sampler", ["archive", "tpe", "nsga2", "random", "family"])
def test_a_seed_gives_the_same_search(sampler: str) -> None:
    if sampler in ("tpe", "nsga2"):
        pytest.importorskip("optuna")
    options = options_of("budget=20", f"sampler={sampler}", "seed=3")
    (first, archive), (second, _) = searched(options), searched(options)
    assert [road.candidate.content for road in first] == [road.candidate.content for road in second]
    assert [road.candidate.weather for road in first] == [CLEAR] * 20
    assert archive.driven.total() == 20
    other, _ = searched(options_of("budget=20", f"sampler={sampler}", "seed=4"))
    assert other[0].candidate.content != first[0].candidate.content


def test_nsga2_evolves_towards_failures() -> None:
    pytest.importorskip("optuna")
    drives, _ = searched(options_of("budget=120", "sampler=nsga2", "seed=1"))
    failed = [drive.outcome.failed for drive in drives]
    assert sum(failed[-40:]) > sum(failed[:40])


def test_the_familys_sampler_draws_from_its_whole_ranges() -> None:
    drives, _ = searched(options_of("budget=24", "sampler=family"))
    for drive in drives:
        assert drive.candidate.parameters["radius"] == drive.candidate.features["bend"]
    assert np.median([drive.candidate.features["bend"] for drive in drives]) < 25


def test_without_optuna_a_line_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(InputError, match=r'sampler=tpe: .*pip install "drivezoo\[optuna\]"'):
        searched(options_of("budget=8", "sampler=tpe"))
