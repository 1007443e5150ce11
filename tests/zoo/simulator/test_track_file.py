"""Tracks as YAML, their geometry, and one-line errors for a user's own."""

import math
import re

import gymnasium
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.zoo.simulator.tracks import loop, refusal, right_of, write_track
from zoo.base.errors import InputError
from zoo.commands.list import description
from zoo.simulator.centreline import STEP_M, make_centreline
from zoo.simulator.track_content import TIGHTEST_RADIUS_M
from zoo.simulator.track_file import make_track, read_track
from zoo.simulator.track_names import (
    ALIASES,
    environment_id,
    recorded_name,
    short_name,
    track_folder,
    track_names,
)
from zoo.simulator.world_settings import WorldSettings

FILES = sorted(track_folder().glob("*.yaml"))
SQUARE = [[0, 0, 0], [60, 0, 0], [60, 60, 0], [0, 60, 0]]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_included_track_can_be_driven(path):
    track = read_track(path.stem)
    assert track.name == recorded_name(path.stem)
    assert 1000 < track.length < 1600
    assert 1 / np.abs(track.curvature).max() > TIGHTEST_RADIUS_M
    assert np.abs(track.grade).max() < (0.27 if "jungle" in track.name else 0.13)
    assert all(stretch.end <= track.length for stretch in track.stretches)


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        ("udacity_jungle", "bends of {radius:.1f} m radius, grades of {down:.0f} %"),
        ("zoo_mountain", "hairpins of {radius:.0f} to 15 m radius, climbs of {up:.0f} %"),
    ],
)
def test_a_tracks_description_has_its_figures(name, figures):
    track = read_track(name)
    radius, grades = 1 / np.abs(track.curvature).max(), 100 * track.grade
    words = figures.format(radius=radius, up=grades.max(), down=-grades.min())
    assert words in description(track_folder() / f"{name}.yaml")


def test_the_mountain_is_narrow_steep_and_winding():
    track = read_track("mountain")
    assert track.width == 5.6
    assert track.centre_line
    assert 11 < 1 / np.abs(track.curvature).max() < 13
    assert track.grade.max() > 0.1
    assert track.grade.min() < -0.1
    verges = {side for stretch in track.stretches for side in (stretch.left, stretch.right)}
    assert {"rock", "drop"} <= verges


@pytest.mark.parametrize("file", ["mine", "lake.yaml", "zoo_lake.yaml", "udacity_jungle.yaml"])
def test_a_users_own_track_needs_only_points_and_has_a_name_of_its_own(tmp_path, file):
    path = (tmp_path / file).with_suffix(".yaml")
    path.write_text(yaml.safe_dump({"points": SQUARE}))
    track = read_track(str(path))
    assert (track.name, track.width, track.stretches) == (file, 6.4, ())


def test_the_file_that_a_strangers_drive_names_as_its_track_is_not_looked_up(tmp_path):
    (tmp_path / "round.yaml").symlink_to("round.yaml")
    assert short_name(str(tmp_path / "round.yaml")) == "round"


def test_a_road_that_crosses_itself_is_refused_with_both_places(tmp_path):
    eight = [[0, 0, 0], [60, 60, 0], [120, 0, 0], [60, -60, 0], [0, 0.5, 0], [-60, 60, 0]]
    eight += [[-120, 0, 0], [-60, -60, 0]]
    line = refusal(write_track(tmp_path, points=eight))
    assert ": points: the road crosses itself, or nearly: " in line
    assert line.count(" m ") >= 2


def test_a_bend_too_tight_for_the_car_is_refused_with_its_place(tmp_path):
    hairpin = [[0, 0, 0], [50, 0, 0], [100, 0, 0], [104, 4, 0], [100, 8, 0], [50, 60, 0]]
    line = refusal(write_track(tmp_path, points=hairpin))
    assert re.search(r": points: the bend at .*m has a radius of ", line)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"widht": 7}, "unknown key widht; did you mean width"),
        ({"width": "broad"}, "width: broad; must be a valid number"),
        ({"points": SQUARE[:3]}, "points: 3 points; a closed loop needs 4 or more"),
        ({"points": [*SQUARE, [0, 0, 0]]}, "do not repeat its first point"),
        ({"points": [[0, 0]]}, "points, number 1, number 3: must be given"),
        ({"verge": {"left": "hedge"}}, "verge: left: hedge; must be 'paved', 'kerb'"),
        ({"verge": "rock"}, "verge: rock; must be keys and values (left, right)"),
        ({"stretches": [{"from": 10, "to": 5}]}, "stretches, number 1: to: 5; must be in 10.."),
        ({"stretches": ["all"]}, "stretches, number 1: all; must be keys and values"),
        ({"surroundings": {"lakes": [[1, 2]]}}, "lakes, number 1, number 3: must be given"),
        ({"surroundings": {"trees": 2.5}}, "surroundings: trees: 2.5; must be a valid integer"),
        ({"surroundings": {"lakes": [[1, 2, math.nan]]}}, "number 1, number 3: nan; must"),
        ({"surroundings": {"lakes": [[1, 2, -3]]}}, "lakes, number 1, number 3: -3; must be"),
        ({"centre_line": "no"}, "centre_line: no; must be a valid boolean"),
        ({"points": [*SQUARE[:3], [False, 60, 0]]}, "points, number 4, number 1: False; must be"),
        ({"points": [[9000 * x for x in point] for point in SQUARE]}, "points: extend over"),
        pytest.param(
            {"points": [[east, 0, 0] for east in range(10_001)]},
            "points: must have at most 10000 items",
            marks=pytest.mark.slow,
        ),
        ({"surroundings": {"lakes": math.nan}}, "surroundings: lakes: "),
        ({"surroundings": {"lakes": [[0, 0, 1e8]]}}, "surroundings: lakes, number 1"),
        ({"surroundings": {"lakes": [[east, 0, 9] for east in range(101)]}}, "at most 100"),
        ({"width": math.nan}, "width: nan"),
    ],
)
def test_a_mistake_is_one_line_with_the_file_and_the_key(tmp_path, content, message):
    assert message in refusal(write_track(tmp_path, **{"points": SQUARE, **content}))


@pytest.mark.parametrize("text", ["", "- 1", "points: [", "\t"])
def test_a_file_that_is_not_a_track_is_refused(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    refusal(str(path))


@pytest.mark.parametrize("key", ["verge", "stretches", "surroundings"])
def test_a_key_without_a_value_counts_as_left_out(tmp_path, key):
    track = read_track(write_track(tmp_path, points=SQUARE, **{key: None}))
    assert getattr(track, key) == getattr(read_track(write_track(tmp_path, points=SQUARE)), key)


def test_an_unknown_track_names_the_known_ones():
    names = "lake, mountain, research_mountain, udacity_jungle, udacity_lake, udacity_mountain"
    with pytest.raises(InputError, match=r"did you mean lake\?"):
        read_track("laek")
    with pytest.raises(InputError, match=rf"there is no track mine\.yaml, .*; available: {names}$"):
        read_track("mine.yaml")


@pytest.mark.parametrize(("alias", "name"), ALIASES.items())
def test_an_alias_is_the_same_road_with_the_same_name_in_records(alias, name):
    first, second = read_track(alias), read_track(name)
    included = read_track(str(track_folder() / f"{name}.yaml"))
    assert first.name == second.name == included.name == alias
    assert np.array_equal(first.xyz, second.xyz)
    assert WorldSettings(track=f"{name},udacity_lake").track == f"{alias},udacity_lake"
    assert name in track_names()
    assert alias not in track_names()


@pytest.mark.parametrize("name", [*track_names(), *ALIASES])
def test_every_track_and_alias_has_a_gymnasium_id(name):
    assert gymnasium.spec(environment_id(name)).kwargs == {"track": name}


TRACKS = {name: read_track(name) for name in track_names()}
ON_ONE_LEVEL = {name: track for name, track in TRACKS.items() if not track.bridge.any()}
anywhere = st.floats(0, 1)
beside = st.floats(-0.9, 0.9)  # share of the half width


@pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)
@given(lap=anywhere, side=beside, near=st.floats(-15, 15))
def test_locate_finds_what_at_gave(track, lap, side, near):
    distance, cte = lap * track.length, side * track.width / 2
    position = track.locate(*right_of(track, distance, cte)[:2], distance + near)
    apart = (position.distance - distance + track.length / 2) % track.length - track.length / 2
    assert abs(apart) < 0.3
    assert position.cte == pytest.approx(cte, abs=0.02)
    assert np.cos(position.heading - track.heading_at(distance)) > 0.999
    assert position.z == pytest.approx(track.at(distance)[2], abs=0.05)


@pytest.mark.parametrize("track", ON_ONE_LEVEL.values(), ids=ON_ONE_LEVEL)
@given(lap=anywhere, side=beside)
def test_locate_needs_no_hint(track, lap, side):
    x, y, _ = right_of(track, lap * track.length, side * track.width / 2)
    both = track.locate(x, y), track.locate(x, y, lap * track.length)
    unhinted, hinted = ((position.x, position.y, position.cte) for position in both)
    # Where two segments meet, either may be the nearest one.
    assert unhinted == pytest.approx(hinted, abs=1e-5)


@pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)
def test_the_loop_is_closed_evenly_sampled_turns_once_and_ends_at_its_own_height(track):
    steps = np.linalg.norm(np.diff(track.xyz[:, :2], axis=0, append=track.xyz[:1, :2]), axis=1)
    assert steps == pytest.approx(STEP_M, abs=0.01)
    assert track.at(track.length) == pytest.approx(track.at(0.0))
    assert len(track.distance) * STEP_M == pytest.approx(track.length, abs=STEP_M)

    turned = track.heading_at(track.length) - track.heading_at(0.0)
    turns = 0 if track.bridge.any() else 1  # a figure of eight does not turn
    assert abs(turned) == pytest.approx(2 * np.pi * turns, abs=1e-9)
    step = track.length / len(track.distance)
    assert track.curvature.sum() * step == pytest.approx(turned, abs=0.02)
    assert track.grade.sum() * step == pytest.approx(0, abs=0.05)


@given(radius=st.floats(12, 200), turn=st.sampled_from([1, -1]), count=st.integers(8, 24))
def test_a_circle_has_its_radius_everywhere_and_left_is_positive(radius, turn, count):
    angle = turn * np.arange(count) * 2 * np.pi / count
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    centreline = make_centreline(ring)
    assert centreline["length"] == pytest.approx(2 * np.pi * radius, rel=0.01)
    assert centreline["curvature"] == pytest.approx(turn / radius, rel=0.1)
    assert centreline["grade"] == pytest.approx(0, abs=1e-6)


def test_a_long_track_is_accepted():
    assert make_track("long", {"points": [[30 * x for x in at] for at in SQUARE]}).length > 5000


def test_stretches_differ_from_the_rest():
    stretches = [
        {"from": 100, "to": 150, "paving": "cobbles", "right": "wall"},
        {"from": 200, "to": 250, "right": "wall"},
    ]
    track = loop(verge={"left": "rock"}, paving="worn", stretches=stretches)
    assert [track.stretch_at(distance).paving for distance in (120.0, 220.0)] == ["cobbles", "worn"]
    both = [track.verge_at(distance) for distance in (120.0 + track.length, 150.0)]
    assert [(verge.left, verge.right) for verge in both] == [("rock", "wall"), ("rock", "paved")]
    assert track.stretch_at(150.0) is None
