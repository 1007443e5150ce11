"""Families of roads, the same for the same seed, and the surveyed roads of the originals."""

import hashlib
from itertools import pairwise

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from tests.refusals import refusal
from tests.slow_members import slow
from tests.zoo.simulator.tracks import right_of, write_track
from zoo.base.errors import InputError
from zoo.simulator.expert import Expert
from zoo.simulator.road_family import (
    MOST_DRAWN_M,
    _length,
    draw_content,
    draw_road,
    family_names,
    find_family,
    roads_digest,
)
from zoo.simulator.simulated_world import Start, World
from zoo.simulator.track_content import TIGHTEST_RADIUS_M
from zoo.simulator.track_file import read_track, track_folder


@pytest.fixture(params=family_names())
def family(request):
    """Return each included family."""
    return find_family(request.param)


# A change of a digest is a change of every recording and figure of these roads.
DIGESTS = {  # of the contents, and of the centrelines in 6 decimals
    "alpine": ("559c577af9c9d28c", "fbf091cc3698e1f8"),
    "country": ("d197acdecb7f63c3", "3ac5524f7163c583"),
    "lakeside": ("db88727f41e310db", "373302257db94734"),
}


@pytest.mark.parametrize("name", DIGESTS)
def test_roads_stay_as_they_are(name):
    names = [f"{name}:{seed}" for seed in (0, 1, 17, 502, 703)]
    roads = [read_track(full_name) for full_name in names]
    raw = [np.column_stack([road.xyz, road.heading, road.curvature, road.widths]) for road in roads]
    values = np.concatenate(raw).round(6) + 0.0
    assert (roads_digest(names), hashlib.sha256(values).hexdigest()[:16]) == DIGESTS[name]


def test_a_digest_of_roads_changes_with_their_content(tmp_path):
    assert roads_digest(["alpine:1", "country:2"]) == roads_digest(["country:2", "alpine:1"])
    assert roads_digest(["alpine:1"]) != roads_digest(["alpine:2"])
    assert roads_digest(["alpine:1", "udacity_lake"]) == roads_digest(["alpine:1"])
    content = yaml.safe_load(find_family("alpine").path.read_text())
    path = write_track(tmp_path, **content)
    before = roads_digest([f"{path}:1"])
    write_track(tmp_path, **content | {"width": [5.0, 6.0]})
    assert roads_digest([f"{path}:1"]) != before


def test_roads_keep_to_the_ranges_of_their_family(family):
    for seed in range(20):
        content, road = draw_content(family, seed)
        low, high = family.width
        assert low - 0.01 <= road.widths.min() <= road.widths.max() <= high + 0.01
        grades = family.grade
        assert grades[0] - 0.01 <= road.grade.min() <= road.grade.max() <= grades[1] + 0.01
        assert road.closed == content["closed"]
        low, high = family.loop if road.closed else family.length
        assert 0.95 * low <= road.length <= (1.3 if road.closed else 1.0) * high + 0.1
        # Transitions make an arc's middle as tight as the arc, not tighter than a few per cent.
        assert np.abs(road.curvature).max() <= 1.1 / family.radius[0]


def test_each_road_has_a_light_of_its_own(family):
    lights = {
        (scene.sun_turn_deg, scene.sun_lift_deg, scene.sun, scene.brightness)
        for scene in (draw_road(family, seed).surroundings for seed in range(5))
    }
    assert len(lights) == 5


@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
def test_the_expert_drives_roads_of_each_family(family, seed):
    road = draw_road(family, seed)
    world, expert = World(road), Expert(road)
    while not world.is_complete(1.0):
        world.step(*expert(world))
        assert not world.off_road, f"{road.name} at {world.place.distance:.0f} m"
        assert world.time < 600


def test_loops_close(family):
    family = family.model_copy(update={"closed": 1.0})
    road = draw_road(family, 1)
    assert road.closed
    turns = (road.heading[-1] - road.heading[0]) / (2 * np.pi)
    assert abs(turns - round(turns)) < 0.03
    steps = np.linalg.norm(np.diff(road.xyz, axis=0, append=road.xyz[:1]), axis=1)
    assert steps.max() < 0.6


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("radius", [90, 15], "radius"),
        ("radius", 15, "radius"),
        ("closed", 2, "closed"),
        ("verges", {"hedge": 1}, "hedge"),
        ("verges", {"rock": 0}, "verges"),
        ("verges", {}, "verges"),
        ("surroundings", {"ground": ["snow"]}, "ground"),
        ("surroundings", {"ground": []}, "ground: .*at least 1 item"),
        ("surroundings", {"ground": "sand"}, "ground: sand; must be"),
        ("lengths", [1, 2], "did you mean length"),
        ("path", "alpine.yaml", "unknown key path"),
    ],
)
def test_wrong_families_name_file_and_key(tmp_path, key, value, message):
    content = yaml.safe_load((find_family("country").path).read_text())
    path = write_track(tmp_path, **content | {key: value})
    with pytest.raises(InputError, match=message) as caught:
        find_family(path)
    assert path in str(caught.value)


def test_ranges_without_a_road_say_so():
    family = find_family("alpine")
    tight = {"radius": (6.0, 6.0), "degrees": (270.0, 270.0)}
    with pytest.raises(InputError, match="alpine:1: the car could take none"):
        draw_road(family.model_copy(update=tight), 1)


@pytest.mark.parametrize(
    "ranges",
    [
        pytest.param({"length": (20_000.0, 20_000.0)}, marks=pytest.mark.slow),
        {"length": (20_000.0, 20_000.0), "straight": (1.0, 1.0), "radius": (6.0, 6.0)},
        {"loop": (20_000.0, 20_000.0), "closed": 1},
    ],
)
def test_the_metres_and_segments_of_all_draws_are_bounded(ranges, monkeypatch):
    family = find_family("alpine")
    family = family.model_copy(update={"closed": 0, "straights": 0.0, **ranges})
    drawn = []

    def refuse(name, content):
        drawn.append(sum(map(_length, content["segments"])))
        raise InputError("no")

    monkeypatch.setattr("zoo.simulator.road_family.make_track", refuse)
    assert "shorten length and loop" in refusal(draw_road, family, 17)
    assert sum(drawn) < MOST_DRAWN_M + 30_000


@pytest.mark.parametrize("seed", [-1, 2**31])
def test_a_seed_out_of_range_is_refused(seed):
    assert f"alpine:{seed}" in refusal(draw_road, find_family("alpine"), seed)


def test_a_road_is_named_wherever_a_track_is():
    road = read_track("alpine:17")
    assert road.name == "alpine:17"
    path = find_family("alpine").path
    np.testing.assert_array_equal(read_track(f"{path}:17").xyz, road.xyz)
    with pytest.raises(InputError, match=r"no track alpine:017, .* such as alpine:17"):
        read_track("alpine:017")  # it would count as another road


def test_a_road_written_to_a_file_is_the_same_road(tmp_path, family):
    for seed in range(5):
        content, road = draw_content(family, seed)
        again = read_track(write_track(tmp_path, **content))
        np.testing.assert_array_equal(again.xyz, road.xyz)
        assert again.surroundings == road.surroundings
        assert again.stretches == road.stretches


def test_an_unknown_family_names_the_known_ones():
    with pytest.raises(InputError, match=r"tundra.*alpine, bends_1.*country, hairpins, lakeside"):
        read_track("tundra:1")


LENGTHS_M = {"udacity_lake": 1138, "udacity_jungle": 1465, "research_mountain": 1314}
LAST_PIECES_M = {"udacity_lake": 10, "udacity_jungle": 5.6, "research_mountain": 10}
RADII_M = {"udacity_lake": 24, "udacity_jungle": 6.4, "research_mountain": 27}
TRACKS = {name: read_track(name) for name in LENGTHS_M}
JUNGLE = TRACKS["udacity_jungle"]
by_track = pytest.mark.parametrize("track", TRACKS.values(), ids=TRACKS)


def reckon(name: str) -> np.ndarray:
    """Return places on the survey's pieces, float64 [N, 3], added up from the first station."""
    survey = np.loadtxt(track_folder() / "surveys" / f"{name}.csv", delimiter=",", skiprows=1)
    station, heading, height = survey.T
    pieces = np.diff(station, append=station[-1] + LAST_PIECES_M[name])
    steps = pieces * np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading))])
    corners = np.stack([*steps.cumsum(1), np.roll(height, -1)], -1)
    corners = np.concatenate([[(0, 0, height[0])], corners])
    assert np.hypot(*corners[-1, :2]) < 0.6  # the gap of a lap, spread over its length
    share = np.linspace(0, 1, len(corners))[:, None]
    corners[:, :2] -= share * corners[-1, :2]
    parts = np.linspace(0, 1, 50, endpoint=False)[:, None]
    return np.concatenate([start + parts * (end - start) for start, end in pairwise(corners)])


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


def test_the_mountain_is_one_course_with_two_looks():
    first, second = TRACKS["research_mountain"], read_track("udacity_mountain")
    np.testing.assert_array_equal(first.xyz, second.xyz)
    assert (first.width, first.centre_line) == (second.width, True)
    assert (second.centre_line, second.paving) == (False, "worn")
    assert any(stretch.tunnel for stretch in second.stretches)


@given(ahead=st.floats(-12, 12), side=st.floats(-3, 3), near=st.floats(-8, 8))
def test_both_levels_of_a_bridge_stay_apart(ahead, side, near):
    for level in (820.0, 1328.0):
        distance = level + ahead
        x, y, _ = right_of(JUNGLE, distance, side)
        position = JUNGLE.locate(x, y, distance + near)
        assert position.distance == pytest.approx(distance, abs=2)
        assert position.z == pytest.approx(JUNGLE.at(distance)[2], abs=0.6)


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
