"""Meshes, bridges, textures, shadows and light, without a renderer."""

from itertools import product
from typing import get_args

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.slow_members import slow, slow_but
from tests.zoo.simulator.surfaces import surfaces_at
from tests.zoo.simulator.test_track_content import EIGHT
from tests.zoo.simulator.tracks import OPEN, loop, right_of
from zoo.simulator.renderer import FAST_ALONG_M, Renderer, landscape
from zoo.simulator.scenery.edges import DECK_M, bridge_meshes, edge_meshes
from zoo.simulator.scenery.frame_effects import bonnet_image
from zoo.simulator.scenery.ground import Ground
from zoo.simulator.scenery.light import Shadows, lit_colours
from zoo.simulator.scenery.mesh import Mesh, cut, grid_triangles, join
from zoo.simulator.scenery.plants import boulder_meshes, place_standing
from zoo.simulator.scenery.road import ALONG_M, daylight, road_levels, road_meshes
from zoo.simulator.scenery.roadside import PITCH_M, road_signs, roadside_meshes
from zoo.simulator.scenery.textures import MEANS, halvings, make_textures
from zoo.simulator.simulated_world import Start, World, open_world
from zoo.simulator.track import LEAVES_M, Track, VergeKind
from zoo.simulator.track_content import make_track
from zoo.simulator.track_file import read_track, track_names
from zoo.simulator.weather import Weather

CLEARANCE_M = 3.5  # smallest height of a bridge's underside above the road below
PLAIN_CASES = [("zoo_mountain", False), ("udacity_jungle", True)]
PLAIN_KINDS = ("kerb", "rock", "drop", "barriers", "closed")


@pytest.fixture(scope="module", params=track_names())
def track(request: pytest.FixtureRequest):
    return read_track(request.param)


def road_places(track: Track) -> np.ndarray:
    """Return places float [N, 3] on the carriageway, every metre along and 7 across."""
    along = np.arange(0, track.length, 1.0)
    lateral = np.linspace(-0.98, 0.98, 7)[:, None] * track.width_at(along) / 2
    return right_of(track, along, lateral).reshape(-1, 3)


def solid_meshes(track: Track, fast: bool) -> list[Mesh]:
    ground = Ground(track, coarse=fast)
    near = [mesh for mesh in road_levels(track) if not mesh.seen_m[0]] if fast else []
    edges = edge_meshes(track, ground, FAST_ALONG_M if fast else ALONG_M)
    built = [*(near or road_meshes(track)), *edges]
    boulders = boulder_meshes(track, ground, "full")
    beside = [*bridge_meshes(track, ground), *roadside_meshes(track, ground)]
    return [*ground.meshes(), *boulders, *built, *beside]


def check_nothing_covers_the_road(track: Track, fast: bool = False) -> None:
    places = road_places(track)
    number, height = surfaces_at(solid_meshes(track, fast), places[:, :2])
    above = height - places[number, 2]
    assert set(number[np.abs(above) < 0.08]) == set(range(len(places))), "a hole in the road"
    covered = places[number[(above > 0.08) & (above < CLEARANCE_M)]]
    assert not len(covered), f"{len(covered)} places, such as {covered[0]}"
    roofed = track.xyz[track.bridge | (daylight(track, track.distance) < 1), :2]
    if (above > CLEARANCE_M).any():
        below = places[number[above > CLEARANCE_M], :2]
        assert cKDTree(roofed).query(below)[0].max() < track.widths.max() / 2 + 1.5


@pytest.mark.parametrize(
    ("name", "fast"), slow_but(PLAIN_CASES, product(track_names(), (False, True)))
)
def test_nothing_covers_the_road_but_bridges_and_tunnels(name: str, fast: bool) -> None:
    """Check the carriageway against every triangle of ground, verges, boulders and bridges."""
    check_nothing_covers_the_road(read_track(name), fast)


def test_the_ground_stays_below_the_shoulders(track) -> None:
    along = np.arange(0, track.length, 1.0)
    ground = Ground(track).meshes()[:1]
    for side in (-1, 1):
        points = right_of(track, along, side * (track.width_at(along) / 2 + 1))
        number, height = surfaces_at(ground, points[:, :2])
        assert (height < points[number, 2]).all(), along[number[height.argmax()]]


def test_no_tree_stands_on_the_road_or_in_water_and_simple_quality_has_fewer(track) -> None:
    ground = Ground(track)
    full, simple = (place_standing(track, ground, quality) for quality in ("full", "simple"))
    feet = np.array([plant.foot[:2] for plant in full if "pine" in plant.kind])
    assert len(feet) > 50
    assert ground.near_road.query(feet)[0].min() > track.surroundings.clear - 0.5
    assert not ground.in_water(feet).any()
    assert len(simple) < len(full) / 2


@pytest.mark.parametrize(
    ("surroundings", "kinds"),
    [
        ({"clear": 60}, {"pine", "tall_pine", "round_tree", "bush", "reeds", "tyres"}),
        ({"lakes": [[50, 40, 2000]]}, {"tyres"}),
    ],
)
def test_a_track_without_room_for_plants_has_fewer(surroundings: dict, kinds: set) -> None:
    track = loop(surroundings=surroundings)
    ground = Ground(track)
    assert {plant.kind for plant in place_standing(track, ground, "simple")} == kinds
    assert bool(boulder_meshes(track, ground, "simple")) == ("bush" in kinds)


def across(track: Track, mesh: Mesh, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances from the centreline, and the heights, of a mesh's points at a place."""
    here, heading = track.at(distance), float(track.heading_at(distance))
    apart = mesh.points - here
    ahead = apart[:, 0] * np.cos(heading) + apart[:, 1] * np.sin(heading)
    near = (np.abs(ahead) < 0.6) & (np.linalg.norm(apart, axis=1) < 16)
    return np.linalg.norm(apart[near, :2], axis=1), apart[near, 2]


def test_the_lakes_kerbs_are_where_the_originals_are() -> None:
    track = read_track("udacity_lake")
    kerbs = next(mesh for mesh in road_meshes(track) if mesh.material == "concrete")
    away, height = across(track, kerbs, 300)
    assert away.min() == pytest.approx(4.8, abs=0.05)
    assert away.max() == pytest.approx(5.95, abs=0.05)
    assert height.max() == pytest.approx(0.35, abs=0.01)


def test_a_rock_face_rises_over_the_length_of_its_taper() -> None:
    track = loop(stretches=[{"from": 100, "to": 200, "left": "rock"}], surroundings={"taper": 10})
    rock = next(mesh for mesh in road_meshes(track) if mesh.material == "rock")
    heights = [across(track, rock, distance)[1].max() for distance in (100, 105, 110, 150, 195)]
    assert heights == pytest.approx([0, 2.5, 5, 5, 2.5], abs=0.6)


def test_barriers_stand_in_a_row_beyond_the_leaves_and_signs_in_bends_behind_them() -> None:
    track = loop(verge={"left": "leaves", "right": "barriers"})
    row = next(mesh for mesh in roadside_meshes(track, Ground(track)) if mesh.material == "hazard")
    assert len(row.points) == 5 * 4 * int(track.length / PITCH_M)
    away = np.array([abs(track.locate(*point[:2]).cte) for point in row.points])
    assert away.min() >= track.width / 2 + LEAVES_M
    signs = [sign for sign in road_signs(track) if sign.kind == "chevron"]
    assert signs
    for sign in signs:
        position = track.locate(*sign.foot[:2])
        assert position.curvature > 0, "the road bends to the left, so its right is the outer side"
        assert position.cte > away.max()


def test_a_tunnel_is_dark_inside_and_leaves_room_for_the_car() -> None:
    stretches = [{"from": 100, "to": 150, "left": "cliff", "right": "cliff", "tunnel": True}]
    track = loop(stretches=stretches)
    light = daylight(track, np.array([50.0, 99.0, 102.0, 125.0, 151.0]))
    assert (light[[0, 1, 4]] == 1).all()
    assert 1 > light[2] > light[3]
    vault = roadside_meshes(track, Ground(track))[0]
    _, height = across(track, vault, 126)
    assert height.max() > 5
    check_nothing_covers_the_road(track)


def test_a_tunnel_is_left_out_where_parts_of_the_road_are_near_each_other() -> None:
    track = track_of(SWITCHBACKS, "dirt", stretches=[{"from": 10, "to": 60, "tunnel": True}])
    assert roadside_meshes(track, Ground(track)) == []


def test_a_side_road_is_closed_by_three_barriers_with_signs() -> None:
    track = loop(stretches=[{"from": 20, "to": 30, "right": "closed"}])
    assert [sign.kind for sign in road_signs(track)] == ["road_closed"] * 3
    (row,) = roadside_meshes(track, Ground(track))
    assert len(row.points) == 3 * 5 * 4


@pytest.mark.parametrize("quality", [*slow("full", "fast"), "simple"])
def test_the_mountain_of_version_1_has_leaves_on_both_sides_and_no_line(quality: str) -> None:
    world = open_world("udacity_mountain", "software", quality)
    for distance in (125.0, 330.0, 620.0, 780.0, 1100.0):
        world.put_back(Start(distance))
        frame = world.frame().astype(int)[70:120]
        red, green, blue = frame.transpose(2, 0, 1)
        leaf = (red > 60) & (green > 0.5 * red) & (blue < 0.35 * green)
        for side in (leaf[:12, :160], leaf[:12, 160:]):
            assert side.any(1).all(), f"no leaves at {distance} m"
        assert np.ptp(frame[20:, 130:190], axis=2).max() < 30, f"a colour on the road, {distance} m"
    world.renderer.close()


def test_mounds_rise_beside_the_road_and_not_on_it() -> None:
    mounds = {"mounds": [[50, 30, 40, 12]]}
    flat, raised = (Ground(loop(surroundings={"hills": 0, **more})) for more in ({}, mounds))
    road = loop().at(50)[:2]
    places = np.array([[50.0, 30.0], road + (0, 11), road])
    rise = raised.height(places) - flat.height(places)
    assert rise == pytest.approx([12, 0, 0], abs=0.1)


def test_a_bare_world_can_be_drawn() -> None:
    bare = loop(surroundings={"trees": 0, "bushes": 0, "rocks": 0, "poles": 0})
    renderer = Renderer(bare, "software")
    assert renderer.frame((0.0, 0.0, 0.0, 0.0, 0.0), "center", 0).std() > 5
    renderer.close()


def square(material: str = "ground") -> Mesh:
    points = np.array([[x, y, 0.0] for y in range(5) for x in range(5)])
    up = np.tile([0.0, 0.0, 1.0], (25, 1))
    return Mesh(material, points, up, np.full((25, 3), 0.5), points[:, :2], grid_triangles(5, 5))


def area(mesh: Mesh) -> float:
    a, b, c = mesh.points[mesh.triangles].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_cutting_and_joining_keep_the_area() -> None:
    whole = square()
    pieces = cut(whole, 1.7)
    assert len(pieces) > 4
    assert sum(map(area, pieces)) == pytest.approx(16)
    assert area(join(pieces)) == pytest.approx(16)


def test_what_faces_the_sun_is_brighter() -> None:
    mesh = square()
    high, low = Weather(sun_elevation_deg=80), Weather(sun_elevation_deg=10)
    assert lit_colours(mesh, high, None).mean() > lit_colours(mesh, low, None).mean() + 10
    shaded = lit_colours(mesh, high, np.zeros(25))
    assert (shaded == lit_colours(mesh, Weather(sun=0), None)).all()


def test_a_trees_shadow_lies_on_the_side_away_from_the_sun() -> None:
    track = read_track("lake")
    ground = Ground(track)
    tree = next(item for item in place_standing(track, ground, "full") if item.kind == "round_tree")
    steps = np.arange(-30, 31)
    around = tree.foot + np.array([[x, y, 0.0] for x, y in product(steps, steps)])
    shadows = Shadows(track, [tree], [around])
    shadows.trees = [tree]
    light = shadows(Weather(sun_azimuth_deg=0, sun_elevation_deg=40))[0]
    dark = around[light < 0.5] - tree.foot
    assert len(dark) > 5
    assert dark[:, 0].mean() < -2  # the sun stands in the east
    assert abs(dark[:, 1].mean()) < 0.5


@pytest.mark.parametrize("name", sorted(MEANS))
def test_a_textures_mean_is_the_same_for_every_seed(name: str) -> None:
    for seed in (1, 2):
        assert make_textures(seed)[name].mean() / 255 == pytest.approx(MEANS[name], abs=0.02)
    assert (make_textures(1)[name] != make_textures(2)[name]).any()


def test_the_asphalt_is_lighter_from_afar() -> None:
    levels = halvings("asphalt", make_textures(1)["asphalt"])
    assert levels[-1].shape == (1, 1, 3)
    assert levels[0].mean() < levels[1].mean() < levels[2].mean()


@pytest.mark.parametrize(("camera", "column"), [("center", 160), ("left", 280), ("right", 40)])
def test_the_bonnet_begins_where_the_originals_does(camera: str, column: int) -> None:
    """Compare the first covered row with the median of 80 of the original's images."""
    _, cover = bonnet_image(camera)
    first = int(np.argmax(cover[:, column, 0] > 0.5))
    assert first == pytest.approx({"center": 137, "left": 137, "right": 136}[camera], abs=1.5)
    assert not cover[:130].any()


def test_a_landscape_is_kept_for_the_same_track_only() -> None:
    lake = landscape(read_track("lake"), "simple")
    assert landscape(read_track("lake"), "simple") is lake
    moved = read_track("lake")
    moved.xyz[:, 2] += 1.0
    higher = landscape(moved, "simple")
    rise = higher[0][0].points[:, 2] - lake[0][0].points[:, 2]
    assert rise == pytest.approx(1.0)
    with pytest.raises(ValueError, match="read-only"):
        lake[0][0].points[0] = 0.0


# Five legs 14 m apart, each 8 m above the last one.
SWITCHBACKS = [
    part
    for turn in ("left", "right", "left", "right")
    for part in ({"straight": 80, "climb": 7}, {turn: 180, "radius": 7, "climb": 1})
] + [{"straight": 80}]


def track_of(segments: list[dict], kind: str = "kerb", **content) -> Track:
    closed = segments is EIGHT
    verge = {"left": kind, "right": kind}
    return make_track("t", {"segments": segments, "closed": closed, "verge": verge, **content})


@pytest.mark.parametrize("kind", slow_but(PLAIN_KINDS, get_args(VergeKind)))
def test_no_verge_covers_the_road_of_a_lower_or_higher_part(kind: str) -> None:
    check_nothing_covers_the_road(track_of(EIGHT, kind))
    check_nothing_covers_the_road(track_of(SWITCHBACKS, kind))
    check_nothing_covers_the_road(track_of(OPEN, kind, widths=[[0, 5], [80, 9], [200, 4]]))


def test_the_lines_follow_the_width() -> None:
    road = track_of(OPEN, widths=[[0, 5], [60, 5], [120, 9]])
    lines = next(mesh for mesh in road_meshes(road) if mesh.material == "plain")
    for distance, half in ((30, 2.5), (180, 4.5)):
        here = road.at(distance)
        near = lines.points[np.linalg.norm(lines.points - here, axis=1) < half + 0.3]
        apart = np.linalg.norm(near[:, :2] - here[:2], axis=1)
        assert apart.min() == pytest.approx(half, abs=0.1)


def test_a_bridge_has_walls_side_faces_and_pillars_beside_the_road_below() -> None:
    road = track_of(EIGHT)
    top, length = road.at(road.length / 2), road.length
    points = np.concatenate([mesh.points for mesh in bridge_meshes(road, Ground(road))])
    assert points[:, 2].max() > top[2] + 0.5
    assert (np.abs(points[:, 2] - (top[2] - DECK_M)) < 0.2).sum() > 50
    low = points[points[:, 2] < top[2] - DECK_M - 1]
    assert len(low)
    below = road.at(np.arange(-20.0, 20.0, 0.5) % length)
    apart = np.linalg.norm(low[:, None, :2] - below[None, :, :2], axis=-1)
    assert apart.min() > road.width / 2 + 1


def test_a_bridge_shades_the_road_below_and_not_itself() -> None:
    road = track_of(EIGHT)
    noon = Weather(sun_elevation_deg=89)
    below, deck = (road.at(distance)[None] for distance in (0.4, road.length / 2))
    shadows = Shadows(road, [], [below, deck])
    assert [light[0] for light in shadows(noon)] == [0.0, 1.0]
    low_sun = Weather(sun_elevation_deg=20, sun_azimuth_deg=0)
    assert [light[0] for light in shadows(low_sun)] == [1.0, 1.0]


def test_ground_lies_behind_both_ends_of_an_open_road_and_a_barrier_stands_there() -> None:
    road = track_of(OPEN)
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
    road = track_of(SWITCHBACKS, "dirt")
    ground = Ground(road)
    faces = [mesh for mesh in edge_meshes(road, ground) if mesh.material == "rock"]
    points = np.concatenate([mesh.points for mesh in faces])
    high, low = points[0::2], points[1::2]
    tall = (high[:, 2] - low[:, 2]) > 3
    assert tall.sum() > 50
    assert (low[tall, 2] < ground.mesh_height(low[tall, :2])).all()


def test_a_bridge_s_walls_stop_the_car_where_the_file_has_none() -> None:
    road = track_of(EIGHT, "dirt")
    world = World(road)
    world.reset(0, Start(road.length / 2, cte=road.width / 2, heading_deg=20, speed_mph=15))
    for _ in range(8):
        world.step(0.0, 0.2)
        assert abs(world.place.cte) < road.width / 2 + 1
    assert world.at_wall
