"""The roads and days of a search: their ranges, features and cells."""

import numpy as np
import pytest

from simulator.road_family import find_family
from simulator.weather import CLEAR, Weather, read_weather
from zoo.search.failure_map import Archive
from zoo.search.search_run import distance_to_usual, usual_features
from zoo.search.search_space import DAYS, SearchSpace, weather_text

ALPINE = find_family("alpine")


@pytest.mark.parametrize("name", ["alpine", "country", "lakeside"])
def test_a_road_has_what_was_chosen(name: str) -> None:
    space = SearchSpace(find_family(name), 100.0, None)
    rng = np.random.default_rng(0)
    for share in (0.1, 0.5, 0.9):
        parameters = {key: one.at(share) for key, one in space.parameters.items()}
        road = space.draw(rng, parameters)
        assert road is not None
        assert not road.track.closed
        assert road.track.length == pytest.approx(100, abs=12)
        assert road.features["bend"] > 0.9 * parameters["radius"]
        assert road.features["width"] >= parameters["width"] - 0.01
        assert road.features["grade"] <= 100 * parameters["grade"] + 0.1
        assert road.features["fog"] == max(round(parameters["fog"], 3), 0)


def test_the_same_seed_draws_the_same_road() -> None:
    space = SearchSpace(ALPINE, 100.0, CLEAR)
    first, second = (space.draw(np.random.default_rng(5), {}) for _ in range(2))
    assert first.content == second.content
    assert first.weather == CLEAR


def test_a_family_that_always_climbs_can_be_searched() -> None:
    climbing = ALPINE.model_copy(update={"grade": (0.05, 0.1)})
    space = SearchSpace(climbing, 100.0, CLEAR)
    low = {key: one.low for key, one in space.parameters.items()}
    road = space.draw(np.random.default_rng(0), low | {"radius": 30.0})
    assert road.features["grade"] == pytest.approx(5, abs=0.2)


def test_a_fixed_day_is_no_feature() -> None:
    assert set(SearchSpace(ALPINE, 100.0, CLEAR).features) == {"bend", "width", "grade"}
    assert not set(DAYS) & set(SearchSpace(ALPINE, 100.0, CLEAR).parameters)


def test_values_beyond_a_range_are_in_the_outer_cells() -> None:
    features = SearchSpace(ALPINE, 100.0, None).features
    grid = Archive("bend", "width", features, 4)
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


def test_the_usual_road_is_the_mildest() -> None:
    space = SearchSpace(ALPINE, 100.0, None)
    usual = usual_features(space)
    assert distance_to_usual(usual, usual, space) == 0
    foggy = distance_to_usual(usual | {"fog": 0.3}, usual, space)
    assert 0 < foggy < distance_to_usual(usual | {"fog": 0.6}, usual, space) < 1


@pytest.mark.parametrize(
    "weather",
    [CLEAR, Weather(fog=0.123, shadows=False), read_weather("{wet: 1, camera: {pitch_deg: 2.5}}")],
)
def test_a_weathers_text_reads_back(weather: Weather) -> None:
    assert read_weather(weather_text(weather)) == weather
