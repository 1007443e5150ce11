"""The original simulators' tracks, against their surveys, and the expert on them."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from simulator.centreline_keys import TIGHTEST_RADIUS_M
from simulator.expert import Expert, ExpertSettings
from simulator.track_file import read_track, track_folder
from simulator.world import Start, World

LENGTHS_M = {"udacity_lake": 1138, "udacity_jungle": 1465, "research_mountain": 1314}
LAST_PIECES_M = {"udacity_lake": 10, "udacity_jungle": 5.6, "research_mountain": 10}
RADII_M = {"udacity_lake": 24, "udacity_jungle": 6.4, "research_mountain": 27}
TRACKS = {name: read_track(name) for name in LENGTHS_M}
JUNGLE = TRACKS["udacity_jungle"]
by_track = pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)


def survey(name: str) -> list[list[float]]:
    lines = (track_folder() / "surveys" / f"{name}.csv").read_text().splitlines()
    return [[float(cell) for cell in line.split(",")] for line in lines[1:]]


def reckon(name: str) -> np.ndarray:
    """Return places on the survey's pieces, float64 [N, 3], added up from the first station."""
    rows = survey(name)
    x = y = 0.0
    corners = [(x, y, rows[0][2])]
    stations = [one[0] for one in rows] + [rows[-1][0] + LAST_PIECES_M[name]]
    for (station, heading, _), end, after in zip(
        rows, stations[1:], [*rows[1:], rows[0]], strict=True
    ):
        x += (end - station) * math.cos(math.radians(heading))
        y += (end - station) * math.sin(math.radians(heading))
        corners.append((x, y, after[2]))
    corners = np.array(corners)
    assert math.hypot(x, y) < 0.6  # the gap of a lap, spread over its length
    share = np.linspace(0, 1, len(corners))[:, None]
    corners[:, :2] -= share * corners[-1, :2]
    parts = np.linspace(0, 1, 50, endpoint=False)[:, None]
    return np.concatenate([one + parts * (other - one) for one, other in pairwise(corners)])


@by_track
def test_the_centreline_keeps_well_within_a_metre_of_the_survey(track):
    places = reckon(track.name)
    apart, nearest = cKDTree(places).query(track.xyz)  # in three dimensions: levels differ
    assert apart.max() < 0.7
    assert np.abs(track.xyz[:, 2] - places[nearest, 2]).max() < 0.5
    assert cKDTree(track.xyz).query(places)[0].max() < 0.7
    assert track.xyz[0, :2] == pytest.approx(places[0, :2], abs=1)
    assert track.length == pytest.approx(LENGTHS_M[track.name], rel=0.003)


@by_track
def test_smoothing_makes_no_bend_tighter_and_curvature_is_continuous(track):
    tightest = 1 / np.abs(track.curvature).max()
    assert tightest > TIGHTEST_RADIUS_M
    assert tightest == pytest.approx(RADII_M[track.name], rel=0.08)
    steps = np.abs(np.diff(track.curvature, append=track.curvature[:1]))
    assert steps.max() < 0.12 * np.abs(track.curvature).max()


def test_the_jungle_passes_over_itself_once():
    upper = JUNGLE.distance[JUNGLE.bridge]
    assert upper.min() < 815
    assert upper.max() > 825
    assert np.ptp(upper) < 40
    assert len(upper) == round(np.ptp(upper) / 0.5) + 1  # one piece
    below = JUNGLE.distance[np.abs(JUNGLE.distance - 1327) < 10]
    height = JUNGLE.at(820)[2] - JUNGLE.at(below)[:, 2]
    assert 17 < height.min() < 22
    assert not any(TRACKS[name].bridge.any() for name in ("udacity_lake", "research_mountain"))


@given(ahead=st.floats(-12, 12), side=st.floats(-3, 3), near=st.floats(-8, 8))
def test_both_levels_of_a_bridge_stay_apart(ahead, side, near):
    for level in (820.0, 1328.0):
        distance = level + ahead
        heading = JUNGLE.heading_at(distance)
        right = np.array([np.sin(heading), -np.cos(heading)])
        x, y = JUNGLE.at(distance)[:2] + side * right
        place = JUNGLE.locate(x, y, distance + near)
        assert place.distance == pytest.approx(distance, abs=2)
        assert place.z == pytest.approx(JUNGLE.at(distance)[2], abs=0.6)


@pytest.mark.parametrize("way", [1, -1])
@by_track
def test_the_expert_drives_a_lap_with_noise_on_the_road(track, way):
    world = World(track, direction=way)
    expert = Expert(track, ExpertSettings(noise=1.0, seed=1))
    world.reset(1)
    before, jump = world.pose()[2], 0.0
    while not world.is_complete(1) and world.time < 200:
        world.step(*expert(world))
        assert not world.off_road
        jump, before = max(jump, abs(world.pose()[2] - before)), world.pose()[2]
    assert world.lap == 1
    assert jump < 0.5  # a car on the bridge is never located on the road below it


def test_a_car_that_leaves_the_bridge_sideways_keeps_its_level():
    world = World(JUNGLE)
    world.reset(0, Start(805, heading_deg=40, speed_mph=20))
    for _ in range(30):
        world.step(0.3, 0.5)
        assert 780 < world.place.distance < 880


def test_lengths_and_licences_are_documented():
    text = (track_folder() / "surveys" / "README.md").read_text()
    for name in LENGTHS_M:
        row = next(line for line in text.splitlines() if line.startswith(f"| `{name}.csv`"))
        assert "github.com" in row
        assert "MIT" in row
