"""The centreline's geometry, on every included track and on circles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.centreline import STEP_M, make_centreline
from simulator.track import Verge
from simulator.track_file import make_track, read_track, track_names

TRACKS = {name: read_track(name) for name in track_names()}
ON_ONE_LEVEL = {name: track for name, track in TRACKS.items() if not track.bridge.any()}
anywhere = st.floats(0, 1)
beside = st.floats(-0.9, 0.9)  # share of the half width


@pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)
@given(lap=anywhere, side=beside, near=st.floats(-15, 15))
def test_locate_finds_what_at_gave(track, lap, side, near):
    distance, cte = lap * track.length, side * track.width / 2
    heading = track.heading_at(distance)
    right = np.array([np.sin(heading), -np.cos(heading)])
    place = track.locate(*(track.at(distance)[:2] + cte * right), distance + near)
    apart = (place.distance - distance + track.length / 2) % track.length - track.length / 2
    assert abs(apart) < 0.3
    assert place.cte == pytest.approx(cte, abs=0.02)
    assert np.cos(place.heading - heading) > 0.999
    assert place.z == pytest.approx(track.at(distance)[2], abs=0.05)


@pytest.mark.parametrize("track", ON_ONE_LEVEL.values(), ids=ON_ONE_LEVEL)
@given(lap=anywhere, side=beside)
def test_locate_needs_no_hint(track, lap, side):
    heading = track.heading_at(lap * track.length)
    right = np.array([np.sin(heading), -np.cos(heading)])
    x, y = track.at(lap * track.length)[:2] + side * track.width / 2 * right
    assert track.locate(x, y) == track.locate(x, y, lap * track.length)


@pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)
def test_the_loop_is_closed_and_evenly_sampled(track):
    steps = np.linalg.norm(np.diff(track.xyz[:, :2], axis=0, append=track.xyz[:1, :2]), axis=1)
    assert steps == pytest.approx(STEP_M, abs=0.01)
    assert track.at(track.length) == pytest.approx(track.at(0.0))
    assert len(track.distance) * STEP_M == pytest.approx(track.length, abs=STEP_M)


@pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)
def test_a_lap_turns_once_and_ends_at_its_own_height(track):
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


def test_stretches_differ_from_the_rest():
    track = make_track(
        "square",
        {
            "points": [[0, 0, 0], [90, 0, 0], [90, 90, 0], [0, 90, 0]],
            "verge": {"left": "rock"},
            "stretches": [{"from": 100, "to": 150, "paving": "cobbles", "right": "wall"}],
        },
    )
    assert track.stretch_at(120.0).paving == "cobbles"
    assert track.verge_at(120.0 + track.length) == Verge("rock", "wall")
    assert track.stretch_at(150.0) is None
    assert track.verge_at(150.0) == Verge("rock", "paved")
