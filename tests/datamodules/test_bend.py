"""The road bends as a camera would see it, and the steering with it."""

import numpy as np
import pytest

from datamodules.augment import Augment
from datamodules.bend import CAMERA, Bend, depth_of
from simulator import rig

BEGUN = -rig.REAR_AXLE_M


@pytest.mark.parametrize("curvature", [0.02, -0.02])
def test_a_straight_line_becomes_the_circle_that_the_camera_would_see(curvature: float) -> None:
    """The reference projects points of a circle that touches the car at its rear axle."""
    moved = Bend().columns_aside(160, curvature, BEGUN, 60.0)
    for ahead in (4.0, 8.0, 15.0):
        along = ahead + rig.CAMERA_POSITIONS["center"][2] + rig.REAR_AXLE_M
        aside = (1 - np.sqrt(1 - (curvature * along) ** 2)) / curvature
        below = np.arctan(CAMERA.up_m / ahead) - np.radians(CAMERA.pitch_down_deg)
        row = 79.5 + CAMERA.focal_px * np.tan(below)  # of 160
        depth = depth_of(ahead)
        assert np.interp(row, np.arange(160), moved) == pytest.approx(
            rig.FOCAL_PX * aside / depth, rel=0.1
        )


def test_a_bend_that_has_begun_steers_by_its_radius_and_a_later_one_not_yet() -> None:
    bend = Bend()
    angle = np.degrees(np.arctan(rig.WHEELBASE_M * 0.05)) / rig.MAX_STEERING_DEG
    assert bend.apply_to_steering(0.1, 0.05, BEGUN) == pytest.approx(0.1 + angle)
    assert bend.apply_to_steering(0.1, -0.05, BEGUN) == pytest.approx(0.1 - angle)
    assert bend.apply_to_steering(0.1, 0.05, 2.0) == pytest.approx(0.1 + angle / 2)
    assert bend.apply_to_steering(0.1, 0.05, 4.0) == 0.1
    assert bend.apply_to_steering(0.9, 0.09, BEGUN) == 1.0


def test_near_rows_stay_until_the_bend_begins_and_far_ones_move_most() -> None:
    moved = Bend().columns_aside(160, 0.05, 6.0, 20.0)
    assert moved[-1] == 0
    assert (np.diff(moved[60:]) <= 0).all()
    assert moved[60] > 20


def test_a_cropped_and_resized_view_moves_like_the_rows_it_shows() -> None:
    whole, cropped = Bend(), Bend()
    cropped.crop = (40, 20)
    of_view = cropped.columns_aside(50, 0.04, BEGUN, 20.0)  # two rows of the recording each
    of_frame = whole.columns_aside(160, 0.04, BEGUN, 20.0)
    assert of_view == pytest.approx(of_frame[40:140].reshape(50, 2).mean(1), abs=0.7)


def test_it_moves_the_image_to_the_side_it_steers_to() -> None:
    image = np.zeros((1, 66, 200, 3), np.uint8)
    image[:, :, 98:102] = 255  # a line straight ahead
    augment = Augment([bend := Bend(p=1.0, begun=1.0)], "rgb")
    bend.crop = (40, 20)
    for seed in range(20):
        changed, steering = augment(image, np.zeros(1, np.float32), seed)
        column = changed[0, 30].mean(-1).argmax()
        if abs(steering[0]) > 0.1:
            assert np.sign(column - 99.5) == np.sign(steering[0])


def test_a_share_of_the_samples_is_left_alone() -> None:
    images = np.random.default_rng(0).integers(0, 255, (400, 8, 16, 1)).astype(np.uint8)
    changed, steering = Augment([Bend(p=0.3, begun=0.5)], "gray")(
        images, np.zeros(400, np.float32), seed=1
    )
    assert 0.2 < (changed != images).any((1, 2, 3)).mean() < 0.4
    assert 0.15 < (steering != 0).mean() < 0.27
