"""Road tests: points in, pass or fail out."""

import math

import numpy as np
import pytest

import drivezoo as zoo
from zoo.simulator.track_content import road_content

STRAIGHT = [(0.0, float(y)) for y in range(0, 40, 4)]
BEND = [(0, 0), (0, 20), (8, 38), (24, 46)]
FAST = {"quality": "simple", "speed": 20, "frame_rate": 10}


def steering(value: float):
    return lambda frame, mph: (value, None)


def test_a_driver_that_stays_in_the_lane_passes() -> None:
    road = zoo.drive_road(steering(0.0), STRAIGHT, **FAST)
    assert road.passed
    assert road.description == "reached the end"
    assert road.largest_m < 0.1
    assert road.drive.xy[-1] == pytest.approx((0, 36), abs=1)


def test_a_driver_that_leaves_the_lane_fails_and_stops_there() -> None:
    road = zoo.drive_road(steering(0.0), BEND, **FAST)
    assert not road.passed
    assert "left the lane after" in road.description
    assert 4.0 < road.largest_m < 6.0
    assert road.drive.driven_m < road.drive.length_m - 1


def test_a_narrow_lane_is_failed_by_a_drive_that_passes_a_wide_one() -> None:
    offset = {"offset": 1.0, **FAST}
    assert zoo.drive_road(steering(0.0), STRAIGHT, **offset).passed
    assert not zoo.drive_road(steering(0.0), STRAIGHT, margin=0.5, **offset).passed
    assert not zoo.drive_road(steering(0.0), STRAIGHT, width=3, offset=2.0, **FAST).passed


def test_a_driver_that_steers_nan_or_turns_back_fails() -> None:
    assert "NaN" in zoo.drive_road(steering(math.nan), STRAIGHT, **FAST).description
    assert not zoo.drive_road(steering(1.0), STRAIGHT, width=30, **FAST).passed


def test_the_same_road_gives_the_same_drive_to_the_bit() -> None:
    def drive() -> tuple:
        road = zoo.drive_road(lambda frame, mph: (frame.mean() / 500 - 0.2, None), BEND, **FAST)
        return road.passed, road.largest_m, road.seconds, road.drive.xy.tobytes()

    assert drive() == drive()


def test_near_points_are_left_out_and_a_level_road_has_no_height() -> None:
    points = [(0, y, -28.0, 8.0) for y in np.arange(0, 30, 0.3)]
    content = road_content(points, 8.0)
    assert len(content["points"]) == 25
    assert content["points"][1] == (0, pytest.approx(1.2), -28.0)
    assert road_content([(1, 2)])["points"] == [(1, 2, 0.0)]


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([(0, 0)], "needs 2 or more"),
        ([(0, 0), (0, 20), (3, 20), (3, 0)], "the car needs"),
        ([(0, 0), (0, math.nan), (0, 30)], "number 2"),
        ([(0, "a"), (1, 2)], "each must be x and y"),
    ],
)
def test_a_road_that_cannot_be_driven_is_one_line(points, words) -> None:
    with pytest.raises(zoo.InputError, match=words):
        zoo.drive_road(steering(0.0), points, **FAST)


def test_a_wrong_key_is_named() -> None:
    for key, words in (("sped", "did you mean speed"), ("track", "no such"), ("start", "no such")):
        with pytest.raises(zoo.UsageError, match=f"{key}: .*{words}"):
            zoo.drive_road(steering(0.0), STRAIGHT, **{key: 9})
