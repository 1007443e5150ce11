"""Bridges, ends of open roads, and parts of a road near each other, in the drawn world."""

import numpy as np
import pytest

from simulator.scenery.edges import DECK_M, bridge_meshes, edge_meshes
from simulator.scenery.ground import Ground
from simulator.scenery.light import Shadows
from simulator.scenery.road import road_meshes
from simulator.track import Track
from simulator.track_content import VERGES, make_track
from simulator.weather import Weather
from simulator.world import Start, World
from tests.simulator.surfaces import surfaces_at
from tests.simulator.test_centreline_keys import EIGHT
from tests.simulator.test_scenery import check_nothing_covers_the_road
from tests.simulator.tracks import OPEN

# Five legs 14 m apart, each 8 m above the last one.
SWITCHBACKS = [
    part
    for turn in ("left", "right", "left", "right")
    for part in ({"straight": 80, "climb": 7}, {turn: 180, "radius": 7, "climb": 1})
] + [{"straight": 80}]


def track(segments: list[dict], kind: str = "kerb", **content) -> Track:
    closed = segments is EIGHT
    verge = {"left": kind, "right": kind}
    return make_track("t", {"segments": segments, "closed": closed, "verge": verge, **content})


@pytest.mark.parametrize("kind", VERGES)
def test_no_verge_covers_the_road_of_a_lower_or_higher_part(kind: str) -> None:
    check_nothing_covers_the_road(track(EIGHT, kind))
    check_nothing_covers_the_road(track(SWITCHBACKS, kind))
    check_nothing_covers_the_road(track(OPEN, kind, widths=[[0, 5], [80, 9], [200, 4]]))


def test_the_lines_follow_the_width() -> None:
    road = track(OPEN, widths=[[0, 5], [60, 5], [120, 9]])
    lines = next(mesh for mesh in road_meshes(road) if mesh.material == "plain")
    for distance, half in ((30, 2.5), (180, 4.5)):
        here = road.at(distance)
        near = lines.points[np.linalg.norm(lines.points - here, axis=1) < half + 0.3]
        apart = np.linalg.norm(near[:, :2] - here[:2], axis=1)
        assert apart.min() == pytest.approx(half, abs=0.1)


def test_a_bridge_has_walls_side_faces_and_pillars_beside_the_road_below() -> None:
    road = track(EIGHT)
    top, length = road.at(road.length / 2), road.length
    meshes = bridge_meshes(road, Ground(road))
    points = np.concatenate([mesh.points for mesh in meshes])
    assert points[:, 2].max() > top[2] + 0.5
    assert (np.abs(points[:, 2] - (top[2] - DECK_M)) < 0.2).sum() > 50
    low = points[points[:, 2] < top[2] - DECK_M - 1]
    assert len(low)
    below = road.at(np.arange(-20.0, 20.0, 0.5) % length)
    apart = np.linalg.norm(low[:, None, :2] - below[None, :, :2], axis=-1)
    assert apart.min() > road.width / 2 + 1


def test_a_bridge_shades_the_road_below_and_not_itself() -> None:
    road = track(EIGHT)
    noon = Weather(sun_elevation_deg=89)
    below, deck = (road.at(distance)[None] for distance in (0.4, road.length / 2))
    shadows = Shadows(road, [], [below, deck])
    assert [light[0] for light in shadows(noon)] == [0.0, 1.0]
    low_sun = Weather(sun_elevation_deg=20, sun_azimuth_deg=0)
    assert [light[0] for light in shadows(low_sun)] == [1.0, 1.0]


def test_ground_lies_behind_both_ends_of_an_open_road_and_a_barrier_stands_there() -> None:
    road = track(OPEN)
    meshes = edge_meshes(road, Ground(road))
    for distance, sign in ((0.0, -1), (road.length, 1)):
        heading = float(road.heading_at(distance))
        ahead = sign * np.array([np.cos(heading), np.sin(heading), 0.0])
        behind = road.at(distance) + np.array([[1.0], [5.0], [12.0]]) * ahead
        number, height = surfaces_at(meshes, behind[:, :2])
        assert set(number) == {0, 1, 2}
        assert np.abs(height - behind[number, 2]).max() < 1.2
        stripes = np.concatenate([mesh.points for mesh in meshes if mesh.material == "stripes"])
        apart = np.linalg.norm(stripes - road.at(distance), axis=1)
        assert apart.min() < 2.5
        assert (((stripes - road.at(distance)) @ ahead)[apart < 5] > 0).all()


def test_faces_close_the_gap_between_parts_at_different_heights() -> None:
    road = track(SWITCHBACKS, "dirt")
    ground = Ground(road)
    faces = [mesh for mesh in edge_meshes(road, ground) if mesh.material == "rock"]
    points = np.concatenate([mesh.points for mesh in faces])
    high, low = points[0::2], points[1::2]
    tall = (high[:, 2] - low[:, 2]) > 3
    assert tall.sum() > 50
    assert (low[tall, 2] < ground.mesh_height(low[tall, :2])).all()


def test_a_bridge_s_walls_stop_the_car_where_the_file_has_none() -> None:
    road = track(EIGHT, "dirt")
    world = World(road)
    world.reset(0, Start(road.length / 2, cte=road.width / 2, heading_deg=20, speed_mph=15))
    for _ in range(8):
        world.step(0.0, 0.2)
        assert abs(world.place.cte) < road.width / 2 + 1
    assert world.at_wall
