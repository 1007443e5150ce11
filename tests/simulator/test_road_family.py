"""Families of roads: the same road for the same seed, roads that the car can take."""

import dataclasses
import hashlib

import numpy as np
import pytest
import yaml

from simulator.expert import Expert
from simulator.road_family import (
    MOST_DRAWN_M,
    _length,
    draw_content,
    draw_road,
    family_names,
    find_family,
    roads_digest,
)
from simulator.track_file import read_track
from simulator.world import World
from zoo.base.errors import InputError


@pytest.fixture(params=family_names())
def family(request):
    """Return each included family."""
    return find_family(request.param)


def test_a_seed_always_draws_the_same_road(family):
    first, again = draw_road(family, 3), draw_road(family, 3)
    np.testing.assert_array_equal(first.xyz, again.xyz)
    np.testing.assert_array_equal(first.widths, again.widths)
    assert first.name == f"{family.name}:3"
    assert draw_road(family, 4).length != first.length


# A change of a digest is a change of every recording and figure of these roads.
DIGESTS = {  # of the contents, and of the centrelines in 6 decimals
    "alpine": ("559c577af9c9d28c", "fbf091cc3698e1f8"),
    "country": ("d197acdecb7f63c3", "3ac5524f7163c583"),
    "lakeside": ("db88727f41e310db", "373302257db94734"),
}


@pytest.mark.parametrize("name", DIGESTS)
def test_roads_stay_as_they_are(name):
    names = [f"{name}:{seed}" for seed in (0, 1, 17, 502, 703)]
    roads = [read_track(one) for one in names]
    columns = [np.column_stack([one.xyz, one.heading, one.curvature, one.widths]) for one in roads]
    values = np.concatenate(columns).round(6) + 0.0
    assert (roads_digest(names), hashlib.sha256(values).hexdigest()[:16]) == DIGESTS[name]


def test_a_digest_of_roads_changes_with_their_content(tmp_path):
    assert roads_digest(["alpine:1", "country:2"]) == roads_digest(["country:2", "alpine:1"])
    assert roads_digest(["alpine:1"]) != roads_digest(["alpine:2"])
    assert roads_digest(["alpine:1", "udacity_lake"]) == roads_digest(["alpine:1"])
    content = yaml.safe_load(find_family("alpine").path.read_text())
    own = tmp_path / "own.yaml"
    own.write_text(yaml.safe_dump(content))
    before = roads_digest([f"{own}:1"])
    own.write_text(yaml.safe_dump(content | {"width": [5.0, 6.0]}))
    assert roads_digest([f"{own}:1"]) != before


def test_roads_keep_to_the_ranges_of_their_family(family):
    for seed in range(20):
        content, road = draw_content(family, seed)
        low, high = family.ranges["width"]
        assert low - 0.01 <= road.widths.min() <= road.widths.max() <= high + 0.01
        grades = family.ranges["grade"]
        assert grades[0] - 0.01 <= road.grade.min() <= road.grade.max() <= grades[1] + 0.01
        assert road.closed == content["closed"]
        low, high = family.ranges["loop" if road.closed else "length"]
        assert 0.95 * low <= road.length <= (1.3 if road.closed else 1.0) * high
        # Transitions make an arc's middle as tight as the arc, not tighter than a few per cent.
        assert np.abs(road.curvature).max() <= 1.1 / family.ranges["radius"][0]


def test_each_road_has_a_light_of_its_own(family):
    lights = {
        (one.sun_turn_deg, one.sun_lift_deg, one.sun, one.brightness)
        for one in (draw_road(family, seed).surroundings for seed in range(5))
    }
    assert len(lights) == 5


def test_the_expert_drives_roads_of_each_family(family):
    for seed in range(3):
        road = draw_road(family, seed)
        world, expert = World(road), Expert(road)
        while not world.is_complete(1.0):
            world.step(*expert(world))
            assert not world.off_road, f"{road.name} at {world.place.distance:.0f} m"
            assert world.time < 600


def test_loops_close(family):
    family = dataclasses.replace(family, shares={**family.shares, "closed": 1.0})
    road = draw_road(family, 1)
    assert road.closed
    turns = (road.heading[-1] - road.heading[0]) / (2 * np.pi)
    assert abs(turns - round(turns)) < 0.03
    steps = np.linalg.norm(np.diff(road.xyz, axis=0, append=road.xyz[:1]), axis=1)
    assert steps.max() < 0.6


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("radius", [90, 15], "radius"),
        ("radius", 15, "radius"),
        ("closed", 2, "closed"),
        ("verges", {"hedge": 1}, "hedge"),
        ("verges", {"rock": 0}, "verges"),
        ("verges", {}, "verges"),
        ("surroundings", {"ground": ["snow"]}, "ground"),
        ("surroundings", {"ground": []}, "ground: \\[\\]; must be a list of sand"),
        ("surroundings", {"ground": "sand"}, "ground: sand; must be a list of sand"),
        ("lengths", [1, 2], "did you mean length"),
    ],
)
def test_wrong_families_name_file_and_key(tmp_path, key, value, named):
    content = yaml.safe_load((find_family("country").path).read_text())
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(content | {key: value}))
    with pytest.raises(InputError, match=named) as caught:
        find_family(str(path))
    assert str(path) in str(caught.value)


def test_ranges_without_a_road_say_so():
    family = find_family("alpine")
    tight = {**family.ranges, "radius": (6.0, 6.0), "degrees": (270.0, 270.0)}
    with pytest.raises(InputError, match="alpine:1: the car could take none"):
        draw_road(dataclasses.replace(family, ranges=tight), 1)


@pytest.mark.parametrize(
    "ranges",
    [
        {"length": (20_000.0, 20_000.0)},
        {"length": (20_000.0, 20_000.0), "straight": (1.0, 1.0), "radius": (6.0, 6.0)},
        {"loop": (20_000.0, 20_000.0), "closed": 1},
    ],
)
def test_the_metres_and_segments_of_all_draws_are_bounded(ranges, monkeypatch):
    family = find_family("alpine")
    closed = ranges.pop("closed", 0)
    shares = {**family.shares, "closed": closed, "straights": 0.0}
    family = dataclasses.replace(family, ranges={**family.ranges, **ranges}, shares=shares)
    drawn = []

    def refuse(name, content):
        drawn.append(sum(map(_length, content["segments"])))
        raise InputError("no")

    monkeypatch.setattr("simulator.road_family.make_track", refuse)
    with pytest.raises(InputError, match="shorten length and loop"):
        draw_road(family, 17)
    assert sum(drawn) < MOST_DRAWN_M + 30_000


@pytest.mark.parametrize("seed", [-1, 2**31])
def test_a_seed_out_of_range_is_refused(seed):
    with pytest.raises(InputError, match=f"alpine:{seed}"):
        draw_road(find_family("alpine"), seed)


def test_a_road_is_named_wherever_a_track_is():
    road = read_track("alpine:17")
    assert road.name == "alpine:17"
    path = find_family("alpine").path
    np.testing.assert_array_equal(read_track(f"{path}:17").xyz, road.xyz)


def test_a_road_written_to_a_file_is_the_same_road(tmp_path, family):
    for seed in range(5):
        content, road = draw_content(family, seed)
        path = tmp_path / "own.yaml"
        path.write_text(yaml.safe_dump(content))
        again = read_track(str(path))
        np.testing.assert_array_equal(again.xyz, road.xyz)
        assert again.surroundings == road.surroundings
        assert again.stretches == road.stretches


def test_an_unknown_family_names_the_known_ones():
    with pytest.raises(InputError, match=r"tundra.*alpine, country, lakeside"):
        read_track("tundra:1")
