"""Labels of training: each recording's steering, or its curvature in one unit for all cars."""

from collections.abc import Iterator

import numpy as np

from datamodules.recording import Recording
from zoo.base.errors import UsageError
from zoo.base.rig import Rig, SteeringLabel


def curvature_label(recording: Recording) -> SteeringLabel:
    """Return the label whose 1 is the smallest full lock of the cars, or a larger driven curvature.

    Side cameras, augmentation and thresholds then have their usual share of the range.

    Raises:
        UsageError: the rig of a recording is unknown.
    """
    driven = np.abs(in_label(recording, recording.steering, SteeringLabel(1.0)))
    least = min(float(rig.curvature(1.0)) for rig in _rigs(recording))
    return SteeringLabel(max(least, float(driven.max())))


def in_label(recording: Recording, steering: np.ndarray, label: SteeringLabel) -> np.ndarray:
    """Return the label of each row's steering, float64 [N]."""
    labels = np.array(steering, float)
    if not label.is_steering:
        for number, rig in enumerate(_rigs(recording)):
            rows = recording.recording == number
            labels[rows] = label.of(labels[rows], rig)
    return labels


def label_lines(recording: Recording, label: SteeringLabel) -> Iterator[str]:
    """Yield a line on the label's unit, and one on each recording's car and what is a guess."""
    if label.curvature_per_m is None:
        return
    yield (
        f"label: curvature, of which 1 is {label.curvature_per_m:.4f} 1/m, a radius of "
        f"{1 / label.curvature_per_m:.1f} m"
    )
    for name, rig in zip(recording.names, _rigs(recording), strict=True):
        guesses = f"; GUESSED: {', '.join(rig.guesses)}" if rig.guesses else ""
        yield (
            f"{name}: {rig.name}, {rig.steering_deg:.1f} degrees of the wheels at full lock, "
            f"wheelbase {rig.wheelbase_m:.2f} m{guesses}"
        )


def _rigs(recording: Recording) -> list[Rig]:
    """Return the rig of each recording."""
    rigs = []
    for name, rig in zip(recording.names, recording.each_rig, strict=True):
        if rig is None:
            raise UsageError(
                f"{name}: data.label=curvature needs the car's wheelbase and steering range, which "
                "its format does not state; write them to rig.yaml in this folder, or name a file "
                "with data.rig=FILE"
            )
        rigs.append(rig)
    return rigs
