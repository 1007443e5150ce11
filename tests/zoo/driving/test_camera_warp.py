"""Warped frames, compared with geometry and with frames of a rendered world."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zoo.base.rig import UDACITY, Camera, single_camera_rig
from zoo.driving.camera_warp import Warp
from zoo.simulator.simulated_world import Start, open_world
from zoo.simulator.udacity_car import CAMERAS, camera_matrix

CENTER = UDACITY.cameras["center"]
# x right, y up and z ahead of the car's origin on the ground.
PLACES = {name: (cam.right_m, cam.up_m, cam.ahead_m) for name, cam in UDACITY.cameras.items()}
WARP = Warp(UDACITY, (160, 320))
RNG = np.random.default_rng(0)
FRAMES = {camera: RNG.integers(0, 256, (160, 320, 3), np.uint8) for camera in CAMERAS}


def project(point: np.ndarray, at: np.ndarray, heading_rad: float) -> np.ndarray:
    """Return the pixel at which a camera sees a point; both positions are right, up, ahead."""
    looks = camera_matrix(0, np.degrees(heading_rad), 0) @ camera_matrix(
        CENTER.pitch_down_deg, CENTER.yaw_right_deg, CENTER.roll_deg
    )
    right, up, ahead = looks.T @ (point - at)
    return (
        np.array([160 + CENTER.focal_px * right / ahead, 80 - CENTER.focal_px * up / ahead]) - 0.5
    )


def test_where_the_car_is_the_frame_is_the_recorded_one():
    assert np.array_equal(WARP(FRAMES.__getitem__, list(CAMERAS), 0.0, 0.0), FRAMES["center"])


def test_where_a_side_camera_was_its_own_frame_is_seen():
    assert abs(PLACES["right"][2] - PLACES["center"][2]) < 0.01

    warped = WARP(FRAMES.__getitem__, list(CAMERAS), PLACES["right"][0], 0.0)

    # The cameras are not quite as far ahead: close to the car that is a part of a pixel.
    assert np.abs(warped[:70].astype(int) - FRAMES["right"][:70]).mean() < 3


@given(
    right_m=st.floats(-2, 2),
    heading_rad=st.floats(-0.5, 0.5),
    ahead=st.floats(4, 200),
    aside=st.floats(-0.5, 0.5),
    camera=st.sampled_from(CAMERAS),
)
def test_a_point_is_looked_up_where_the_camera_saw_it(right_m, heading_rad, ahead, aside, camera):
    turn = camera_matrix(0, np.degrees(heading_rad), 0)
    seen_from = turn @ PLACES["center"] + (right_m, 0, 0)
    point = seen_from * (1, 0, 1) + turn @ (aside * ahead, 0, ahead)
    u, v = project(point, seen_from, heading_rad)
    truth = project(point, np.array(PLACES[camera]), 0.0)
    x, y = (grid.reshape(160, 320) for grid in WARP.maps(camera, right_m, heading_rad))

    left, top = int(np.floor(u)), int(np.floor(v))
    if not (0 <= left < 319 and 0 <= top < 159):
        return
    corners = [(x[row, col], y[row, col]) for row in (top, top + 1) for col in (left, left + 1)]

    low, high = np.min(corners, 0), np.max(corners, 0)
    assert (low - 0.1 <= truth).all()
    assert (truth <= high + 0.1).all()


def test_a_turn_moves_what_is_far_away_and_a_step_aside_does_not():
    turned, _ = WARP.maps("center", 0.0, 0.1)
    aside, _ = WARP.maps("center", 1.0, 0.0)
    sky = 10 * 320 + 160

    assert turned[sky] - 160 == pytest.approx(0.1 * CENTER.focal_px, rel=0.1)
    assert aside[sky] == pytest.approx(160, abs=0.01)


@pytest.mark.parametrize("pose", [(0.3, 0.05), (-0.9, -0.1), (2.0, 0.7)])
def test_the_bonnet_stays(pose):
    warped = WARP(FRAMES.__getitem__, list(CAMERAS), *pose)

    assert np.array_equal(warped[145:, 120:180], FRAMES["center"][145:, 120:180])
    assert not np.array_equal(warped[80:90, 120:180], FRAMES["center"][80:90, 120:180])


@pytest.mark.parametrize(
    ("right_m", "nearest"), [(-0.7, "left"), (-0.3, "center"), (0.3, "center"), (0.7, "right")]
)
def test_the_nearest_camera_is_used_and_one_is_enough(right_m, nearest):
    frames = {camera: np.full((160, 320, 3), 50 * n, np.uint8) for n, camera in enumerate(CAMERAS)}
    middle = (slice(80, 100), slice(120, 200))

    seen = WARP(frames.__getitem__, list(CAMERAS), right_m, 0.0)
    assert (seen[middle] == frames[nearest][middle]).all()
    assert (WARP(frames.__getitem__, ["center"], right_m, 0.0)[middle] == 0).all()


def test_no_other_bonnet_is_smeared_over_the_road():
    frames = {camera: np.full((160, 320, 3), 90, np.uint8) for camera in CAMERAS}
    for row in (150, 159):
        frames["right"][row - 5 : row + 1, :120] = 255  # its bonnet is there

    assert WARP(frames.__getitem__, list(CAMERAS), 0.6, 0.0).max() == 90


def test_the_own_car_of_any_rig_stays_where_the_camera_sees_it():
    bonnet = ((0, 480), (0, 400), (640, 400), (640, 480))
    camera = Camera(0.0, 1.4, 0.4, size=(640, 480), own_car=(bonnet,))
    frame = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
    warp = Warp(single_camera_rig("car", camera, 2.85, 30.0), (240, 320))

    warped = warp(lambda _: frame, ["center"], 0.5, 0.1)

    same = (warped == frame).all((1, 2))
    assert np.flatnonzero(same).tolist() == list(range(198, 240))


@pytest.mark.parametrize("stretched", [(480, 640), (240, 640)])
def test_the_ground_moves_by_the_rigs_own_camera(stretched):
    """A point that a camera 1.4 m above it sees 10 m ahead moves by f / 10 for a metre aside."""
    camera = Camera(0.0, 1.4, 0.4, size=(640, 480), vertical_fov_deg=45.0)
    warp = Warp(single_camera_rig("car", camera, 2.85, 30.0), stretched)
    height, width = stretched
    row = round(height / 2 + camera.focal_px * 1.4 / 10 * height / 480 - 0.5)

    x, y = (grid.reshape(height, width) for grid in warp.maps("center", 1.0, 0.0))

    assert x[row, width // 2] - width // 2 == pytest.approx(camera.focal_px / 10, abs=0.5)
    assert y[row, width // 2] == pytest.approx(row, abs=0.01)
    assert x[0, width // 2] == pytest.approx(width // 2)


@pytest.mark.parametrize("pose", [(0.5, 0.0), (0.5, 3.0), (-0.7, -4.0)])
def test_it_looks_like_the_world_from_there(pose, world):
    right_m, heading_deg = pose
    differences = []
    for distance in (40.0, 300.0, 700.0):
        world.put_back(Start(distance))
        frames = {camera: world.frame(camera) for camera in CAMERAS}
        x, y, heading = world.car.x, world.car.y, world.car.heading
        x, y = x + right_m * np.sin(heading), y - right_m * np.cos(heading)
        world.car.place(x, y, heading - np.radians(heading_deg))
        truth = world.frame().astype(int)
        warped = WARP(frames.__getitem__, list(CAMERAS), right_m, np.radians(heading_deg))
        road = [np.abs(image - truth)[60:130].mean() for image in (warped, frames["center"])]
        differences.append(road)

    warped_off, recorded_off = np.mean(differences, 0)
    assert warped_off < 0.6 * recorded_off


@pytest.fixture(scope="module")
def world():
    world = open_world("lake", quality="simple")
    yield world
    world.renderer.close()
