"""Meshes, textures, shadows and light, without a renderer."""

import numpy as np
import pytest
import yaml
from scipy.interpolate import LinearNDInterpolator

from simulator.pictures import open_pictures
from simulator.scenery.bonnet import bonnet_picture
from simulator.scenery.ground import Ground
from simulator.scenery.light import lit_colours
from simulator.scenery.mesh import Mesh, cut, grid_triangles, join
from simulator.scenery.plants import place_standing
from simulator.scenery.road import road_meshes
from simulator.scenery.shadows import Shadows
from simulator.scenery.textures import MEANS, halvings, make_textures
from simulator.track_file import make_track, read_track, track_folder, track_names
from simulator.weather import Weather


@pytest.fixture(scope="module", params=track_names())
def track(request: pytest.FixtureRequest):
    return read_track(request.param)


def test_the_ground_never_sticks_out_of_the_road(track) -> None:
    """Check carriageway and shoulders against every triangle of the ground."""
    ground = Ground(track).meshes()[0]
    height = LinearNDInterpolator(ground.points[:, :2], ground.points[:, 2])
    along = np.arange(0, track.length, 1.0)
    heading = track.heading_at(along)
    right = np.stack([np.sin(heading), -np.cos(heading)], -1)
    for cte in np.linspace(-1, 1, 9) * (track.width / 2 + 1):
        points = track.at(along)[:, :2] + cte * right
        above = track.at(along)[:, 2] - height(points)
        assert above.min() > 0, f"{above.min():.2f} m at {along[above.argmin()]} m, {cte:+.1f}"


def test_the_road_is_where_the_track_is(track) -> None:
    meshes = road_meshes(track)
    asphalt = next(mesh for mesh in meshes if mesh.material == "asphalt")
    for point in asphalt.points[::997]:
        place = track.locate(*point[:2])
        assert abs(place.cte) < track.width / 2 + track.shoulder + 2
        assert point[2] == pytest.approx(place.z, abs=0.3)


def test_no_tree_stands_on_the_road_or_in_the_water(track) -> None:
    ground = Ground(track)
    trees = [one for one in place_standing(track, ground, "full") if "pine" in one.kind]
    feet = np.array([tree.foot[:2] for tree in trees])
    assert len(trees) > 50
    assert ground.near_road.query(feet)[0].min() > track.surroundings.clear - 0.5
    assert not ground.in_water(feet).any()


def test_simple_quality_has_fewer_plants(track) -> None:
    ground = Ground(track)
    full, simple = (place_standing(track, ground, quality) for quality in ("full", "simple"))
    assert len(simple) < len(full) / 2


def test_a_bare_world_can_be_drawn() -> None:
    content = yaml.safe_load((track_folder() / "zoo_lake.yaml").read_text())
    content["surroundings"] = {"trees": 0, "bushes": 0, "rocks": 0, "poles": 0}
    content["stretches"] = []
    pictures = open_pictures(make_track("bare", content), "software")
    assert pictures.frame((0.0, 0.0, 0.0, 0.0, 0.0), "center", 0).std() > 5
    pictures.close()


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
    tree = next(one for one in place_standing(track, ground, "full") if one.kind == "round_tree")
    around = tree.foot + np.array(
        [[x, y, 0.0] for x in np.arange(-30, 31) for y in np.arange(-30, 31)]
    )
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
        texture = make_textures(seed)[name]
        assert texture.mean() / 255 == pytest.approx(MEANS[name], abs=0.02)
    assert (make_textures(1)[name] != make_textures(2)[name]).any()


def test_the_asphalt_is_lighter_from_afar() -> None:
    levels = halvings("asphalt", make_textures(1)["asphalt"])
    assert levels[-1].shape == (1, 1, 3)
    assert levels[0].mean() < levels[1].mean() < levels[2].mean()


@pytest.mark.parametrize(("camera", "column"), [("center", 160), ("left", 280), ("right", 40)])
def test_the_bonnet_begins_where_the_originals_does(camera: str, column: int) -> None:
    """Compare the first covered row with the median of 80 of the original's images."""
    _, cover = bonnet_picture(camera)
    first = int(np.argmax(cover[:, column, 0] > 0.5))
    assert first == pytest.approx({"center": 137, "left": 137, "right": 136}[camera], abs=1.5)
    assert not cover[:130].any()
