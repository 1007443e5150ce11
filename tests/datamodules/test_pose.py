"""The augmentation that moves the car, against geometry and the embedded simulator."""

from dataclasses import replace

import numpy as np
import pytest

from datamodules.augmented_batch import Augment
from datamodules.bend import Pose
from tests.datamodules.test_augment import fitted
from zoo.base.rig import UDACITY, SteeringLabel
from zoo.simulator.simulated_world import Start, World, open_world

STRAIGHT_M = 150.0  # along udacity_lake, where the road is straight and flat
NOTHING = {"curvature": 0.0, "aside_m": 0.0, "turn_deg": 0.0}
MIDDLE = 135  # a column of the road, at all poses
STEERING = np.linspace(-1, 1, 21)[:, None]


def steered(pose: Pose, bent_m: float = 0.0, aside_m: float = 0.0, turn_deg: float = 0.0) -> float:
    """Return the steering of a straight road's image that is changed so."""
    values = np.array([[bent_m, aside_m, np.radians(turn_deg)]])
    return float(pose.steer(np.zeros((1, 1)), values)[0, 0])


def test_where_nothing_is_changed_the_label_is_the_recorded_steering() -> None:
    drawn = fitted(Pose(**NOTHING)).draw((21, 160, 320, 3), np.random.default_rng(0))
    assert not drawn.any()
    assert fitted(Pose()).steer(STEERING, drawn) == pytest.approx(STEERING, abs=1e-12)


def test_a_curvature_label_is_changed_as_the_steering_of_that_curvature() -> None:
    label = SteeringLabel(float(UDACITY.curvature(1.0)))
    images, steering = np.zeros((21, 8, 16, 1), np.uint8), STEERING[:, 0].astype(np.float32)
    _, by_steering = Augment([fitted(Pose(p=1.0))], "gray")(images, steering, seed=3)
    curvature = label.of(steering, UDACITY)
    _, by_curvature = Augment([fitted(Pose(p=1.0))], "gray", label)(images, curvature, seed=3)
    assert by_curvature == pytest.approx(label.of(by_steering, UDACITY), abs=1e-6)


def test_a_bend_from_the_rear_axle_steers_by_its_radius() -> None:
    """A circle's chord is shorter than its arc, and the parabola's chord is not: 2 % here."""
    pose, curvature = fitted(Pose()), 0.05
    label = steered(pose, bent_m=curvature * pose.pursuit_m**2 / 2)
    assert label == pytest.approx(UDACITY.steering_of(curvature), rel=0.03)


@pytest.mark.parametrize(("aside_m", "turn_deg"), [(0.8, 0), (-1.2, 0), (0.0, 8), (0.5, -6)])
def test_the_label_leads_back_to_the_line(aside_m: float, turn_deg: int) -> None:
    """The reference drives the circle of the label until it has come 4.3 m far."""
    pose = fitted(Pose())
    curvature = float(UDACITY.curvature(steered(pose, aside_m=aside_m, turn_deg=turn_deg)))
    right, ahead, heading, step = aside_m, 0.0, np.radians(turn_deg), 0.001
    while np.hypot(right - aside_m, ahead) < np.hypot(pose.pursuit_m, aside_m):
        right += step * np.sin(heading)
        ahead += step * np.cos(heading)
        heading += step * curvature
    assert right == pytest.approx(0.0, abs=0.02)


@pytest.fixture(scope="module")
def world() -> World:
    return open_world("udacity_lake", quality="fast")


@pytest.mark.parametrize(("aside_m", "turn_deg"), [(0.9, 0), (-0.9, 0), (0.0, 6), (0.6, 6)])
def test_the_image_is_that_of_the_moved_car(aside_m: float, turn_deg: int, world: World) -> None:
    """The bright verges of the road lie as the simulator's car sees them from there."""
    pose, turn = fitted(Pose()), np.radians(turn_deg)

    def frame(cte: float, heading_deg: float) -> np.ndarray:
        world.reset(0, Start(distance=STRAIGHT_M, cte=cte, heading_deg=heading_deg))
        return world.frame().copy()

    unchanged = frame(0.0, 0.0)
    moves = pose.columns_aside(160, (np.zeros((1, 1)),) * 3, aside_m, turn)[0]
    pose.change_one(changed := unchanged.copy(), np.concatenate([np.zeros(Pose.values), moves]))
    # The car is turned about its rear axle, and placed by its origin.
    rendered = frame(aside_m + UDACITY.rear_axle_m * float(np.sin(turn)), turn_deg)
    error = np.median(np.abs(verges(changed) - verges(rendered)))
    assert error < 0.3 * np.median(np.abs(verges(unchanged) - verges(rendered)))


def verges(frame: np.ndarray) -> np.ndarray:
    """Return the columns where the verges begin left and right of the road, [2, rows]."""
    bright = frame[75:90, :, 0] > 200
    right = MIDDLE + bright[:, MIDDLE:].argmax(1)
    return np.stack([MIDDLE - bright[:, MIDDLE::-1].argmax(1), right])


def test_windows_have_one_pose_and_a_label_for_each_row() -> None:
    drawn = fitted(Pose()).draw((5, 8, 16, 1), np.random.default_rng(1))
    labels = fitted(Pose()).steer(np.zeros((5, 4)), drawn)
    assert labels == pytest.approx(np.repeat(labels[:, :1], 4, axis=1))
    assert len(np.unique(labels)) == 5


def test_another_car_has_another_label() -> None:
    pose = Pose()
    pose.fit((0, 0), replace(UDACITY, front_axle_m=2 * UDACITY.front_axle_m))
    assert abs(steered(pose, aside_m=0.8)) > abs(steered(fitted(Pose()), aside_m=0.8))
