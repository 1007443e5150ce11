"""The cameras' frames, drawn by the software renderer."""

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest
from panda3d import core

from tests.refusals import refusal
from tests.slow_members import slow_but
from tests.zoo.command_runs import ROOT, run_words
from tests.zoo.simulator.tracks import loop
from zoo.base.errors import InputError
from zoo.simulator.renderer import Renderer
from zoo.simulator.simulated_world import Start, World, open_world
from zoo.simulator.track_file import read_track, track_names
from zoo.simulator.udacity_car import CAMERAS, CameraOffset
from zoo.simulator.weather import CLEAR, Weather


@pytest.fixture(scope="module")
def lake() -> Iterator[World]:
    world = open_world("lake", renderer="software")
    yield world
    world.renderer.close()


def look(world: World, weather: Weather = CLEAR, camera: str = "center", **start) -> np.ndarray:
    world.reset(0, Start(**start), weather)
    return world.frame(camera)


def test_the_horizon_stands_where_the_original_has_it(lake: World) -> None:
    """Pitched down 9.5 degrees, the lens puts the horizon at row 56.8; sky above, road below."""
    frame = look(lake, distance=330)
    assert (frame.shape, frame.dtype) == ((160, 320, 3), np.uint8)
    frame = frame.astype(int)
    assert frame[5, :, 2].mean() > frame[5, :, 0].mean() + 40
    road = frame[70:130, 150:170]
    assert (road.max(-1) - road.min(-1)).mean() < 25


def yellow_columns(frame: np.ndarray, row: int) -> np.ndarray:
    red, green, blue = frame[row].astype(int).T
    return np.flatnonzero((red > blue + 45) & (green > blue + 35) & (red > 110))


def test_the_road_is_as_wide_as_in_the_original(lake: World) -> None:
    """Lines 6.4 m apart, seen from 1.2 m, are 5.3 columns apart per row below the horizon."""
    row = 90
    columns = yellow_columns(look(lake, distance=330), row)
    left, right = columns[columns < 160].max(), columns[columns > 160].min()
    assert (right - left) / (row - 56.8) == pytest.approx(5.3, abs=0.45)


def test_a_car_to_the_right_sees_the_road_to_the_left(lake: World) -> None:
    means = [yellow_columns(look(lake, distance=330, cte=cte), 90).mean() for cte in (-0.8, 0, 0.8)]
    assert means[0] > means[1] > means[2]


def test_the_left_camera_is_left_of_the_right_one(lake: World) -> None:
    center, left, right = (
        yellow_columns(look(lake, camera=camera, distance=330), 90).mean() for camera in CAMERAS
    )
    assert left > center > right


def test_the_bonnet_covers_the_lower_edge_and_does_not_move(lake: World) -> None:
    first, second = (look(lake, distance=d)[152:] for d in (330, 480))
    assert (first[:, 100:220] == second[:, 100:220]).all()


@pytest.mark.parametrize(
    ("change", "sign"),
    [({"brightness": 0.6}, -1), ({"sun": 0.2}, -1), ({"wet": 1.0}, -1), ({"brightness": 1.3}, 1)],
)
def test_weather_changes_the_roads_brightness(lake: World, change: dict, sign: int) -> None:
    usual, changed = (
        look(lake, weather, distance=330)[80:130, 120:200].mean()
        for weather in (CLEAR, replace(CLEAR, **change))
    )
    assert sign * (changed - usual) > 5


def test_fog_hides_what_is_far_and_not_the_road_ahead(lake: World) -> None:
    clear, fog = (look(lake, w, distance=330) for w in (CLEAR, replace(CLEAR, fog=0.8)))
    assert fog[20:50].std() < clear[20:50].std() / 2
    assert np.abs(fog[120:130].astype(int) - clear[120:130]).mean() < 25


def test_blur_spreads_a_lines_edge_and_keeps_the_brightness(lake: World) -> None:
    sharp, soft, softer = (
        look(lake, replace(CLEAR, blur=blur), distance=330).astype(int) for blur in (0, 1.5, 4)
    )
    edges = [np.abs(np.diff(image[80:130], axis=1)).max() for image in (sharp, soft, softer)]
    assert edges[0] > 1.5 * edges[1] > 1.5 * 1.5 * edges[2]
    assert soft.mean() == pytest.approx(sharp.mean(), abs=1)
    assert "blur=-1" in refusal(replace, CLEAR, blur=-1)


@pytest.mark.parametrize("change", [{"rain": 0.7}, {"noise": 5.0}])
def test_rain_and_noise_differ_between_frames_but_not_runs(lake: World, change: dict) -> None:
    runs = []
    for _ in range(2):
        lake.reset(3, Start(330), replace(CLEAR, **change))
        first = lake.frame()
        lake.frames += 1
        runs.append((first, lake.frame()))
    assert (runs[0][0] == runs[1][0]).all()
    assert (runs[0][0] != runs[0][1]).any()


def test_a_displaced_camera_gives_a_displaced_frame(lake: World) -> None:
    up = replace(CLEAR, camera=CameraOffset(pitch_deg=3))
    straight, raised = look(lake, distance=330), look(lake, up, distance=330)
    # A camera pitched up by 3 degrees moves objects ahead down by about 7 rows.
    rows = straight[70:100].mean((1, 2))
    shifts = [np.abs(raised[70 + s : 100 + s].mean((1, 2)) - rows).mean() for s in range(13)]
    assert 5 <= int(np.argmin(shifts)) <= 10


def test_a_wider_angle_of_view_shows_the_same_things_smaller(lake: World) -> None:
    wide = replace(CLEAR, camera=CameraOffset(fov_deg=20))
    usual, wider = look(lake, distance=330), look(lake, wide, distance=330)
    smaller = np.tan(np.radians(30)) / np.tan(np.radians(40))
    shrunk = cv2.resize(usual, None, fx=smaller, fy=smaller, interpolation=cv2.INTER_AREA)
    top, left = (160 - len(shrunk)) // 2, (320 - shrunk.shape[1]) // 2
    above_bonnet = slice(20, 70), slice(20, 200)
    moved, same, other = (
        cv2.blur(image, (5, 5))[above_bonnet].astype(float)
        for image in (wider[top:, left:], shrunk, usual[top:, left:])
    )
    assert np.abs(moved - same).mean() < 8
    assert np.abs(moved - other).mean() > 20
    assert (look(lake, distance=330) == usual).all(), "the next drive has its own angle again"


@pytest.mark.parametrize("name", slow_but(["zoo_lake"], track_names()))
@pytest.mark.parametrize("every_m", [70.0, pytest.param(5.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("quality", ["simple", "fast"])
def test_the_camera_sees_the_road_along_the_lap(name: str, every_m: float, quality: str) -> None:
    """Check a world in which the road is red and everything else is blue."""
    world = open_world(name, renderer="software", quality=quality)
    for path in world.renderer.root.findAllMatches("**/+GeomNode"):
        path.setTextureOff(1)
        paved = path.getName() in ("asphalt", "worn", "cobbles", "plain")
        path.setColor((1, 0, 0, 1) if paved else (0, 0, 1, 1), 1)
    for number, distance in enumerate(np.arange(0, world.track.length - 8, every_m)):
        world.direction = (1, -1)[number % 2]
        frame = look(world, distance=world.track.length - distance if number % 2 else distance)
        assert (frame[108:134, 125:195, 0] == 255).all(), f"{distance:.0f} m, {world.direction}"
    world.renderer.close()


def test_shadows_fall_on_the_mountain_road() -> None:
    world = open_world("mountain", renderer="software")
    light = np.concatenate(world.renderer.shadows(CLEAR))
    assert 0.005 < (light < 0.5).mean() < 0.3
    world.renderer.close()


def test_a_track_turns_the_sun_of_every_weather() -> None:
    shown = []
    for track, azimuth in ((loop(), 100.0), (loop(surroundings={"sun_turn_deg": 60}), 40.0)):
        renderer = Renderer(track, "software")
        renderer.set_weather(replace(CLEAR, sun_azimuth_deg=azimuth), 0)
        shown.append(renderer.frame((0.0, 0.0, 0.0, 0.0, 0.0), "center", 0))
        renderer.close()
    assert (shown[0] == shown[1]).all()


def test_nothing_is_kept_of_earlier_frames_and_worlds() -> None:
    counts = []
    for _ in range(3):
        world = open_world(loop(), "software")
        for distance in range(0, 200, 20):
            world.put_back(Start(distance))
            world.frame()
        world.renderer.close()
        del world
        counts.append(core.RenderState.getNumStates() + core.TransformState.getNumStates())
    assert counts[0] == counts[2]


def test_the_next_renderer_takes_a_closed_ones_buffer_and_shares_no_open_one() -> None:
    first, other = open_world("lake", "software"), open_world("lake", "software")
    assert first.renderer.buffer != other.renderer.buffer
    shown = look(first, CLEAR, distance=330)
    first.renderer.close()
    first.renderer.close()  # once more hands no buffer out twice
    again, third = open_world("alpine:17", "software"), open_world("lake", "software")
    assert again.renderer.buffer == first.renderer.buffer != third.renderer.buffer
    look(again, Weather(fog=0.2), distance=120)
    again.renderer.close()
    later = open_world("lake")
    assert later.renderer.buffer == first.renderer.buffer
    assert (look(later, CLEAR, distance=330) == shown).all()
    for world in (other, third, later):
        world.renderer.close()


# A change of a digest is a change of every score and recording of that quality.
DIGESTS = {"full": "063841ce1f805dbb", "fast": "a79ed75109423e62"}


@pytest.mark.parametrize("quality", DIGESTS)
def test_the_frames_of_a_quality_stay_the_same(quality: str) -> None:
    world = open_world("alpine:17", "software", quality)
    digest = hashlib.sha256()
    for distance, camera in zip((10.0, 120.0, 250.0), CAMERAS, strict=True):
        digest.update(look(world, Weather(fog=0.2, wet=0.5), camera, distance=distance).tobytes())
    assert digest.hexdigest()[:16] == DIGESTS[quality]
    world.renderer.close()


def test_most_pixels_near_the_car_are_the_same_in_fast_frames(lake: World) -> None:
    fast = open_world("lake", "software", "fast")
    full, other = (look(world, distance=330)[64:] for world in (lake, fast))
    assert (full == other).all(-1).mean() > 0.5
    fast.renderer.close()


def test_a_wrong_renderer_or_quality_is_named() -> None:
    track = read_track("lake")
    assert "renderer=vulkan: must be auto, software or opengl" in refusal(Renderer, track, "vulkan")
    with pytest.raises(InputError, match="quality=low: must be full, fast or simple"):
        Renderer(track, "software", "low")


def test_without_libx11_the_error_names_the_package(tmp_path) -> None:
    (tmp_path / "libX11.so.6").touch()  # found first, but not a library
    code = "from zoo.simulator.simulated_world import open_world; open_world('lake', 'software')"
    result = run_words(ROOT, sys.executable, "-c", code, LD_LIBRARY_PATH=str(tmp_path))
    assert "apt install libx11-6" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", track_names())
def test_a_hundred_days_render(name: str) -> None:
    world = open_world(name, renderer="software")
    rng = np.random.default_rng(0)
    for seed in range(100):
        world.reset(seed, Start(rng.uniform(0, world.track.length)), "random")
        frame = world.frame()
        assert 15 < frame.mean() < 240, seed
        assert frame[60:130].std() > 4, seed
    world.renderer.close()
