import numpy as np
import pytest

from datamodules.samples import CENTER, LEFT, RIGHT, make_samples, recovery_steering
from tests.recordings import recording_in_memory
from zoo.base.errors import InputError

ALL = ["center", "left", "right"]


def test_left_steers_right_and_right_steers_left():
    samples = make_samples(recording_in_memory([0.1]), np.array([0]), ALL, offset=0.25)
    assert samples.camera.tolist() == [CENTER, LEFT, RIGHT]
    np.testing.assert_allclose(samples.steering, [0.1, 0.35, -0.15], atol=1e-7)


def test_corrected_steering_is_clipped_to_full_lock():
    samples = make_samples(recording_in_memory([0.9, -0.9]), np.array([0, 1]), ALL, offset=0.25)
    np.testing.assert_allclose(samples.steering, [0.9, 1, 0.65, -0.9, -0.65, -1], atol=1e-7)


def test_samples_of_a_row_stand_together_in_the_order_of_the_cameras():
    recording = recording_in_memory(np.zeros(5))
    samples = make_samples(recording, np.array([1, 3]), ["right", "center"], 0.25)
    assert samples.row.tolist() == [1, 1, 3, 3]
    assert samples.camera.tolist() == [CENTER, RIGHT, CENTER, RIGHT]


def test_only_recorded_cameras_make_samples():
    recording = recording_in_memory(np.zeros(3), cameras=("center", "right"))
    samples = make_samples(recording, np.array([0, 2]), ALL, 0.25)
    assert samples.camera.tolist() == [CENTER, RIGHT] * 2


def test_brake_is_throttle_below_zero():
    recording = recording_in_memory(np.zeros(2))
    recording.throttle[:], recording.brake[:] = [0.7, 0.0], [0.0, 0.4]
    samples = make_samples(recording, np.arange(2), ["center"], 0.25)
    np.testing.assert_allclose(samples.throttle, [0.7, -0.4])


def test_columns_fit_their_rows():
    recording = recording_in_memory(np.zeros(4), speed_mph=np.array([1.0, 2, 3, 4]))
    samples = make_samples(recording, np.array([3, 1]), ["center", "left"], 0.25)
    np.testing.assert_array_equal(samples.speed_mph, recording.speed_mph[samples.row])
    assert samples.steering.dtype == samples.throttle.dtype == samples.speed_mph.dtype == np.float32


def test_both_ways_is_everything_a_second_time_mirrored():
    recording = recording_in_memory([0.1, -0.2])
    samples = make_samples(recording, np.arange(2), ALL, 0.25, both_ways=True)
    assert samples.flipped.tolist() == [False] * 6 + [True] * 6
    np.testing.assert_array_equal(samples.row[:6], samples.row[6:])
    np.testing.assert_array_equal(samples.camera[:6], samples.camera[6:])
    np.testing.assert_array_equal(samples.steering[:6], samples.steering[6:])


def test_one_way_is_not_mirrored():
    assert not make_samples(recording_in_memory([0.1]), np.array([0]), ALL, 0.25).flipped.any()


def test_recovery_against_a_hand_computation():
    """20 mph is 8.94 m/s: 17.88 m in 2 s.

    An arc through a point 17.88 m ahead and 0.806 m aside has the curvature
    2 * 0.806 / (17.88^2 + 0.806^2) = 0.005031 per m; with a wheelbase of 2.87 m the wheels turn
    atan(2.87 * 0.005031) = 0.8273 degrees of 25.
    """
    assert recovery_steering(-0.806, 20.0, 2.0) == pytest.approx(0.8273 / 25, abs=1e-5)


def test_driving_the_recovery_arc_ends_on_the_line():
    steering = float(recovery_steering(-0.806, 9.0, 2.0))
    x, y, heading = 0.0, -0.806, 0.0  # metres ahead and to the right of the line
    distance = 9.0 * 0.44704 * 2.0
    step = 0.001
    while x < distance:
        heading += step * np.tan(np.radians(25 * steering)) / 2.87
        x += step * np.cos(heading)
        y += step * np.sin(heading)
    assert y == pytest.approx(0, abs=0.01)


def test_recovery_of_left_and_right_cameras_by_speed():
    recording = recording_in_memory([0.0, 0.0], speed_mph=np.array([30.0, 10.0]))
    samples = make_samples(recording, np.arange(2), ALL, offset=9.9, recover_s=2.0)
    fast, slow = samples.steering.reshape(2, 3)
    assert fast[CENTER] == slow[CENTER] == 0
    assert 0 < fast[LEFT] < slow[LEFT] < 1
    assert 0 > fast[RIGHT] > slow[RIGHT] > -1


def test_recovery_of_a_standing_car_is_that_of_four_metres():
    at_rest = recovery_steering(0.825, 0.0, 2.0)
    assert at_rest == recovery_steering(0.825, 4 / 0.44704 / 2, 2.0)
    assert -1 < at_rest < -0.3


@pytest.mark.parametrize("cameras", [["centre"], ["center", "back"], []])
def test_unknown_camera(cameras):
    with pytest.raises(InputError, match=r"data\.cameras=.*center, left, right"):
        make_samples(recording_in_memory([0.0]), np.array([0]), cameras, 0.25)


def test_no_image_of_the_cameras_wanted():
    recording = recording_in_memory([0.0], cameras=("center",))
    with pytest.raises(InputError, match="no row has an image"):
        make_samples(recording, np.array([0]), ["left", "right"], 0.25)
