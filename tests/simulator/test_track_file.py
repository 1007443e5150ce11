"""Tracks as YAML: the included ones, and one-line errors for a user's own."""

import math

import gymnasium
import numpy as np
import pytest
import yaml

from simulator.centreline_keys import TIGHTEST_RADIUS_M
from simulator.track_file import read_track
from simulator.track_names import (
    ALIASES,
    environment_id,
    recorded_name,
    track_folder,
    track_names,
)
from simulator.world_settings import WorldSettings
from zoo.base.errors import InputError

FILES = sorted(track_folder().glob("*.yaml"))
SQUARE = [[0, 0, 0], [60, 0, 0], [60, 60, 0], [0, 60, 0]]


def write_track(folder, **content):
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({"points": SQUARE, **content}))
    return str(path)


def refusal(path: str) -> str:
    with pytest.raises(InputError) as error:
        read_track(path)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_included_track_can_be_driven(path):
    track = read_track(path.stem)
    assert track.name == recorded_name(path.stem)
    assert 1000 < track.length < 1600
    assert 1 / np.abs(track.curvature).max() > TIGHTEST_RADIUS_M
    assert np.abs(track.grade).max() < (0.27 if "jungle" in track.name else 0.13)
    assert all(one.end <= track.length for one in track.stretches)


def test_the_mountain_is_narrow_steep_and_winding():
    track = read_track("mountain")
    assert track.width == 5.6
    assert track.centre_line
    assert 11 < 1 / np.abs(track.curvature).max() < 13
    assert track.grade.max() > 0.1
    assert track.grade.min() < -0.1
    verges = {side for one in track.stretches for side in (one.verge.left, one.verge.right)}
    assert {"rock", "drop"} <= verges


def test_a_users_own_track_needs_only_points(tmp_path):
    track = read_track(write_track(tmp_path))
    assert (track.name, track.width, track.stretches) == ("mine", 6.4, ())


def test_a_road_that_crosses_itself_is_refused_with_both_places(tmp_path):
    eight = [[0, 0, 0], [60, 60, 0], [120, 0, 0], [60, -60, 0], [0, 0.5, 0], [-60, 60, 0]]
    eight += [[-120, 0, 0], [-60, -60, 0]]
    path = write_track(tmp_path, points=eight)
    line = refusal(path)
    assert line.startswith(f"{path}: points: the road crosses itself, or nearly: ")
    assert line.count(" m ") >= 2


def test_a_bend_too_tight_for_the_car_is_refused_with_its_place(tmp_path):
    hairpin = [[0, 0, 0], [50, 0, 0], [100, 0, 0], [104, 4, 0], [100, 8, 0], [50, 60, 0]]
    path = write_track(tmp_path, points=hairpin)
    line = refusal(path)
    assert line.startswith(f"{path}: points: the bend at ")
    assert "m has a radius of " in line


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"widht": 7}, "unknown key widht; did you mean width?"),
        ({"width": "broad"}, "width: broad; must be a number in 3..30"),
        ({"points": SQUARE[:3]}, "points: 3 points; a closed loop needs 4 or more"),
        ({"points": [*SQUARE, [0, 0, 0]]}, "do not repeat the first one"),
        ({"points": [[0, 0]]}, "points: each must be [x, y, z] in metres"),
        ({"points": None}, "points: each must be [x, y, z] in metres"),
        ({"verge": {"left": "hedge"}}, "verge: left: hedge; must be one of paved, kerb"),
        ({"verge": "rock"}, "verge: rock; must be keys and values (left, right)"),
        ({"surroundings": ["trees"]}, "surroundings: ['trees']; must be keys and values"),
        ({"stretches": [{"from": 10, "to": 5}]}, "stretches, number 1: to: 5; must be a number"),
        ({"stretches": {"from": 10}}, "stretches: must be a list"),
        ({"stretches": ["all"]}, "stretches, number 1: must have from: and to:"),
        ({"surroundings": {"ground": "ice"}}, "surroundings: ground: ice; must be one of"),
        ({"surroundings": {"mounds": [[1, 2, 3]]}}, "mounds: each must be [x, y, radius, height]"),
        ({"surroundings": {"lakes": [[1, 2]]}}, "lakes: each must be [x, y, radius]"),
        ({"surroundings": {"lakes": "deep"}}, "lakes: each must be [x, y, radius]"),
        ({"surroundings": {"trees": -1}}, "surroundings: trees: -1; must be a number"),
        ({"surroundings": {"trees": 2.5}}, "surroundings: trees: 2.5; must be a whole number"),
        ({"surroundings": {"trees": "9"}}, "surroundings: trees: 9; must be a number"),
        ({"surroundings": {"hill_size": 0}}, "hill_size: 0; must be a number in 1.."),
        ({"surroundings": 0}, "surroundings: 0; must be keys and values"),
        ({"surroundings": {"lakes": [[1, 2, math.nan]]}}, "lakes: each must be [x, y, radius]"),
        ({"surroundings": {"lakes": [[1, 2, -3]]}}, "lakes, number 1: the radius is -3"),
        ({"centre_line": "no"}, "centre_line: 'no'; must be true or false"),
        ({"centre_line": 1}, "centre_line: 1; must be true or false"),
        ({"width": -6}, "width: -6; must be a number in 3..30"),
        ({"width": "6.4"}, "width: 6.4; must be a number"),
        ({"width": math.nan}, "width: nan; must be a number"),
        ({"shoulder": math.inf}, "shoulder: inf; must be a number"),
        ({"points": [*SQUARE[:3], ["0", "60", "0"]]}, "points: each must be [x, y, z]"),
        ({"points": [*SQUARE[:3], [False, 60, 0]]}, "[False, 60, 0] (number 4)"),
        ({"points": [*SQUARE[:3], [0, math.inf, 0]]}, "[0, inf, 0] (number 4)"),
        ({"verge": False}, "verge: False; must be keys and values"),
        ({"stretches": {}}, "stretches: must be a list"),
    ],
)
def test_a_mistake_is_one_line_with_the_file_and_the_key(tmp_path, content, message):
    path = write_track(tmp_path, **content)
    line = refusal(path)
    assert line.startswith(f"{path}: ")
    assert message in line


@pytest.mark.parametrize("text", ["", "- 1", "points: [", "\t"])
def test_a_file_that_is_not_a_track_is_refused(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    assert refusal(str(path)).startswith(f"{path}: ")


@pytest.mark.parametrize("key", ["verge", "stretches", "surroundings"])
def test_a_key_without_a_value_counts_as_left_out(tmp_path, key):
    track = read_track(write_track(tmp_path, **{key: None}))
    assert getattr(track, key) == getattr(read_track(write_track(tmp_path)), key)


def test_an_unknown_track_names_the_known_ones():
    assert "did you mean lake?" in refusal("laek")
    assert "lake, mountain, research_mountain, udacity_jungle, udacity_lake" in refusal("laek")
    assert "there is no track mine.yaml" in refusal("mine.yaml")


@pytest.mark.parametrize(("alias", "name"), ALIASES.items())
def test_an_alias_is_the_same_road_with_the_same_name_in_records(alias, name):
    first, second = read_track(alias), read_track(name)
    included = read_track(str(track_folder() / f"{name}.yaml"))
    assert first.name == second.name == included.name == alias
    assert np.array_equal(first.xyz, second.xyz)
    assert WorldSettings(track=f"{name},udacity_lake").track == f"{alias},udacity_lake"
    assert name in track_names()
    assert alias not in track_names()


def test_a_users_own_file_keeps_its_name(tmp_path):
    path = tmp_path / "zoo_lake.yaml"
    path.write_text(yaml.safe_dump({"points": SQUARE}))
    assert read_track(str(path)).name == "zoo_lake"


@pytest.mark.parametrize("name", [*track_names(), *ALIASES])
def test_every_track_and_alias_has_a_gymnasium_id(name):
    assert gymnasium.spec(environment_id(name)).kwargs == {"track": name}
