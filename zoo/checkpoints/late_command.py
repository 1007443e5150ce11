"""Steering for the time at which it reaches the wheels, from a network that predicts steps ahead.

The steps are those of a car that steers as the network says. A late car still steers by earlier
commands. The difference moves it off that course, and the command returns it: a Smith predictor
(Smith, "Closer control of loops with dead time", 1957).
"""

import numpy as np

from zoo.base.rig import MPS_PER_MPH, UDACITY

# A car returns to its course as by pure pursuit of a point this far ahead: what the side cameras
# teach with data.offset=0.275.
RETURN_M = 6.2


def outputs_at(outputs: np.ndarray, steps: float) -> np.ndarray:
    """Return the outputs for a time ahead, interpolated between two steps.

    Args:
        outputs: outputs for now and for the steps ahead, [1 + ahead, outputs].
        steps: time ahead, in steps; a time after the last step counts as the last step.

    >>> outputs_at(np.array([[0.0], [0.4], [0.2]]), 1.5).round(1).tolist()
    [0.3]
    """
    steps = min(max(steps, 0.0), len(outputs) - 1.0)
    before = int(steps)
    after = min(before + 1, len(outputs) - 1)
    return outputs[before] + (steps - before) * (outputs[after] - outputs[before])


def returning(predicted: np.ndarray, sent: np.ndarray, way_m: float, steps: float) -> float:
    """Return the steering, -1..1, that returns a car from where the sent commands lead it.

    Args:
        predicted: steering for now and for the steps ahead, -1..1 [1 + ahead].
        sent: steering that the wheels have until the command reaches them, -1..1 [n], evenly spaced
            in time.
        way_m: distance that the car drives in that time.
        steps: steps in that time.

    >>> returning(np.array([0.0, 0.0]), np.array([0.1, 0.1]), 4.0, 1.0) < -0.1
    True
    """
    if not len(sent):
        return 0.0
    parts = (np.arange(len(sent)) + 0.5) / len(sent)
    course = np.interp(parts * steps, np.arange(len(predicted)), predicted)
    bends = _curvature(sent) - _curvature(course)
    part_m = way_m / len(sent)
    turned = np.cumsum(bends) * part_m
    right_m = float(np.sum(turned - bends * part_m / 2)) * part_m
    back = -2 * (right_m + RETURN_M * float(turned[-1])) / RETURN_M**2
    return float(np.degrees(np.arctan(UDACITY.wheelbase_m * back))) / UDACITY.steering_deg


def distance_m(speed_mph: float, seconds: float) -> float:
    """Return the distance in metres that a car drives."""
    return max(speed_mph, 0.0) * MPS_PER_MPH * seconds


def _curvature(steering: np.ndarray) -> np.ndarray:
    return np.tan(np.radians(steering * UDACITY.steering_deg)) / UDACITY.wheelbase_m
