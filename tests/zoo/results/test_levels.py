"""Suites with axes: levels on the same roads, drives up to the first intervention, and a person."""

import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.refusals import refusal
from tests.zoo.results.test_benchmark_command import drive, verify, write_family
from zoo.driving import baseline
from zoo.results.benchmarked import PAGE, levels_table, overall
from zoo.results.checked_result import read_result
from zoo.results.comparison import ComparedEntries
from zoo.results.levels import level_at
from zoo.results.suite import place_of, read_suite
from zoo.simulator.hand_control import Hands
from zoo.simulator.hand_page import Seat
from zoo.simulator.track_names import track_folder


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a suite of two levels on three roads of 60 m."""
    folder = tmp_path_factory.mktemp("levels")
    family = str(write_family(folder, radius=[7, 9], degrees=[90, 120], straight=[6, 8]))
    levels = [{"family": family}, {"family": family, "speed": 18}]
    path = folder / "levels.yaml"
    content = {"name": "levels", "axes": {"dynamics": levels}, "roads": 3, "mean_steering": 0.0}
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.mark.parametrize(
    ("name", "roads", "levels", "count"),
    # A change of the roads is a change of every figure.
    [
        pytest.param("v2", "7a91dc108c9c6d23", 5, 12, marks=pytest.mark.slow),
        ("v3", "1b2c79d07725de54", 3, 20),
    ],
)
def test_levels_are_on_the_same_places(name: str, roads: str, levels: int, count: int) -> None:
    suite, dev = read_suite(name), read_suite(name, "dev")
    assert suite.roads == roads
    assert {planned.scenario.quality for planned in suite.drives} == {"fast"}
    places: dict[tuple[str, int], list[str]] = {}
    for planned in suite.drives:
        places.setdefault((planned.group, planned.level), []).append(place_of(planned.track))
    assert len(places) == 4 * levels
    for (axis, _), names in places.items():
        assert names == places[axis, 1]
        assert len(set(names)) == count
    tracks, dev_tracks = ({planned.track for planned in part.drives} for part in (suite, dev))
    assert not tracks & dev_tracks


def test_drives_of_levels_end_at_their_first_intervention(suite: Path, tmp_path: Path) -> None:
    zero, expert = (drive([name], suite, tmp_path / name) for name in ("zero", "expert"))
    lost = read_result(zero)
    assert [record.level for record in lost.drives] == [1, 1, 1, 2, 2, 2]
    assert all(record.figures["interventions"] <= 1 for record in lost.drives)
    assert any(record.figures["interventions"] for record in lost.drives)
    figures = overall(read_result(expert))
    assert figures["without_intervention"].value == 1
    assert figures["falls_to_50"].value == 2.5  # beyond the last level
    assert figures["worst_tenth_m"].value < 1
    assert levels_table(lost).columns[1].heading == "level 1"
    assert "level 2" in (zero / PAGE).read_text()
    verify(zero, suite)
    compared = ComparedEntries.read(expert, zero)
    assert "clean drives 100.0%" in compared.lines[0]
    assert compared.result_table().columns[2].figures["without_intervention_a"][-1] == 1


def test_other_drives_of_the_suite_drive_the_whole_road(suite: Path, tmp_path: Path) -> None:
    content = yaml.safe_load(suite.read_text())
    track = f"{content['axes']['dynamics'][0]['family']}:1"
    path = tmp_path / "mixed.yaml"
    path.write_text(yaml.safe_dump(content | {"roads": 1, "groups": {"plain": [{"track": track}]}}))
    mixed = read_result(drive(["zero"], path, tmp_path / "out"))
    assert [record.figures["interventions"] > 1 for record in mixed.drives] == [True, False, False]
    assert mixed.score == "without_intervention", "the autonomy of a drive that ended says little"


def test_speed_and_the_file_of_a_track_are_part_of_what_is_compared(tmp_path: Path) -> None:
    path, lap = tmp_path / "own.yaml", tmp_path / "lap.yaml"
    path.write_text(yaml.safe_dump({"name": "own", "speed": 20, "laps": [str(lap)]}))
    lap.write_bytes((track_folder() / "zoo_lake.yaml").read_bytes())
    usual = read_suite(str(path)).usual
    assert [*usual.values()][:2] == [20.0, "full"]
    lap.write_text(f"{lap.read_text()}# another version\n")
    assert read_suite(str(path)).usual != usual


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("like: v9\n", r"like: 'v9' is not included; available: course.*v2"),
        ("like: [v2]\n", r"like: \['v2'\] is not included"),
        ("name: a\naxes: {sharp: [{family: alpine}]}\n", "axes.sharp: "),
        ("name: a\naxes: {sharp: [{family: alpin}, {family: alpin}]}\n", "sharp: alpin:.*alpine"),
        ("like: v2\ngroups: {laps: [{track: lake}]}\n", r"groups\.laps: is taken; choose"),
        ("like: v3\ngroups: {geometry: [{track: lake}]}\n", r"groups\.geometry: is taken"),
        ("like: v2\nroads: 100000000\n", "roads: .*1000"),
    ],
)
def test_a_wrong_suite_of_levels_gets_one_line(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(content)
    assert re.search(words, refusal(read_suite, str(path)))


def test_a_curve_is_found_with_an_interval_that_fewer_places_widen() -> None:
    rng, levels = np.random.default_rng(0), np.tile(np.arange(1, 6), 40)
    places = np.repeat(np.arange(40), 5)
    clean = (rng.random((1, 200)) < 1 / (1 + np.exp(2 * (levels - 3.5)))) * 1.0
    level = level_at(0.5, clean, levels.tolist(), places.tolist())
    few = level_at(0.5, clean[:, :40], levels[:40].tolist(), places[:40].tolist())
    assert level.value == pytest.approx(3.5, abs=0.3)
    assert level.low < level.value < level.high
    assert few.high - few.low > level.high - level.low
    assert level_at(0.9, clean, levels.tolist(), places.tolist()).value < level.low


@pytest.mark.parametrize(("outcome", "level"), [(1.0, 5.5), (0.0, 0.5)])
def test_a_share_that_is_never_crossed_is_beyond_the_levels(outcome: float, level: float) -> None:
    levels, places = [1, 2, 3, 4, 5] * 4, [road for road in range(4) for _ in range(5)]
    assert level_at(0.5, np.full((2, 20), outcome), levels, places).value == level


def test_a_person_steers_in_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    seat = Seat()
    monkeypatch.setattr(baseline, "_seat", lambda: seat)
    steer: Callable = baseline.by_hand(0.04)
    seat.answer({"after": ["1"]})  # a page watches
    seat.take("hands", Hands({"arrow_left"}))
    began = time.monotonic()
    steered = [steer(np.zeros((2, 2, 3), np.uint8), 15.0)[0] for _ in range(2)]
    assert 0 > steered[0] > steered[1]
    assert time.monotonic() - began > 0.07
    seat.take("press", "escape")
    with pytest.raises(KeyboardInterrupt):
        steer(np.zeros((2, 2, 3), np.uint8), 15.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"cte_max_m"', '"other"', r"drives.0.figures.cte_max_m: is missing"),
        ('"file": "zero"', '"file": "human"', "a person drove it"),
    ],
)
def test_drives_of_a_person_or_without_their_largest_error_are_not_repeated(
    suite: Path, tmp_path: Path, old: str, new: str, words: str
) -> None:
    path = drive(["zero"], suite, tmp_path / "out") / "result.json"
    path.write_text(path.read_text().replace(old, new))
    assert words in refusal(verify, path, suite)
