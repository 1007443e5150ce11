"""Painted lines lie on the road, and mean nothing."""

import numpy as np
import pytest

from datamodules import ground
from datamodules.augment import Augment
from datamodules.lines import WHITE, Lines


def test_a_line_straight_ahead_is_where_the_camera_would_see_it() -> None:
    frame = np.zeros((160, 320, 3), np.uint8)
    Lines().change_one(frame, [(1.0, 0.2, 0.0, 45.0, WHITE)])
    for ahead in (3.0, 6.0, 12.0):
        row = round(float(ground.row_of(np.float64(ahead))))
        columns = np.flatnonzero(frame[row].any(-1))
        expected = 159.5 + ground.FOCAL_PX / ground.depth_of(ground.metres_ahead(np.float64(row)))
        assert columns.mean() == pytest.approx(expected, abs=0.6)


def test_a_cropped_and_resized_view_shows_it_at_the_same_place() -> None:
    line = (-0.8, 0.3, 0.02, 45.0, WHITE)
    frame, view = np.zeros((160, 320, 1), np.uint8), np.zeros((50, 160, 1), np.uint8)
    Lines().change_one(frame, [line])
    cropped = Lines()
    cropped.crop = (40, 20)
    cropped.change_one(view, [line])
    small = frame[40:140].reshape(50, 2, 160, 2).mean((1, 3))
    assert np.abs(small - view[:, :, 0]).mean() < 2
    assert view.any()


def test_the_steering_stays_and_a_share_is_left_alone() -> None:
    pictures = np.zeros((300, 66, 200, 3), np.uint8)
    steering = np.linspace(-1, 1, 300, dtype=np.float32)
    augment = Augment([lines := Lines(p=0.5)], "rgb")
    lines.crop = (40, 20)
    changed, same = augment(pictures, steering, seed=1)
    assert (same == steering).all()
    assert 0.35 < (changed != pictures).any((1, 2, 3)).mean() < 0.6


@pytest.mark.parametrize("colour", ["gray", "hsv_s"])
def test_views_of_one_channel_are_painted_too(colour: str) -> None:
    pictures = np.zeros((20, 16, 32, 1), np.uint8)
    changed, _ = Augment([Lines(p=1.0)], colour)(pictures, np.zeros(20, np.float32), seed=1)
    assert changed.any()
