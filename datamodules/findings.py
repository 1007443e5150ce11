"""Figures of a recording, what is unusual about it, and what to do about that."""

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from datamodules.recording import GAP_S, Recording
from datamodules.stretches import LEAST_CHANGE, find_stretches, steering_returns

# The thresholds separate the original's keyboard recording (70 % of steering is 0, the other 798
# rows share 414 values) from the expert's (no 0, as many values as rows).
ZERO_SHARE = 0.4
DISTINCT_SHARE = 0.8
# The expert's recordings of recoveries have 6 to 7 in 1,000 rows; with as many normal laps, 3.
RECOVERIES_PER_ROW = 1 / 1000
# A tenth of fewer rows (validation or test) is less than one block of ten seconds: one place.
FEW_ROWS = 1000
STRAIGHT_CAP, NEARLY_STRAIGHT = 0.5, 0.1  # of conf/data/recording.yaml
SPEED_WINDOW_MPH, SPEEDS_APART_MPH = 3, 6
SPEEDS_SHARE, SECOND_SPEED_SHARE = 0.8, 0.2
SIDE_SHARE = 0.75
FEW_TURNS = 50  # rows with a steering, below which their side is chance
STANDSTILL_MPH = 1.0
IDENTICAL_SHARE = 0.01
KEYBOARD_SHARE = 0.4  # share of steering exactly 0 above which it usually is a keyboard's


@dataclass(frozen=True)
class Finding:
    """An oddity of a recording: its kind, and one line of text for the user."""

    kind: str
    text: str


def find_oddities(recording: Recording) -> list[Finding]:
    """Return what is unusual about a recording; several are judged as one."""
    found = []
    for kind, look in _LOOKS.items():
        text = look(recording)
        if text:
            found.append(Finding(kind, text))
    return found


def _few_rows(recording: Recording) -> str | None:
    rows = len(recording)
    if rows >= FEW_ROWS:
        return None
    return (
        f"only {rows:,} rows: validation and test cover one place each, and a network memorizes "
        "the road; record two laps or more (about 2,700 rows), or try with quick=true"
    )


def _keyboard(recording: Recording) -> str | None:
    steering = recording.steering
    turned = steering[steering != 0]
    share, values = 1 - len(turned) / len(steering), len(np.unique(turned))
    if share <= ZERO_SHARE or 0 < DISTINCT_SHARE * len(turned) <= values:
        return None
    return (
        f"{share:.0%} of steering is exactly 0 and the other {len(turned):,} rows share {values:,} "
        f"values, as from a keyboard: a network learns to drive straight and to jerk; "
        f"{_cap(recording)}steer by mouse or gamepad (drivezoo simulator drive)"
    )


def _cap(recording: Recording) -> str:
    """Return what the usual limit of nearly straight samples does for a recording."""
    cameras = np.count_nonzero(recording.images.astype(bool)) / len(recording)
    # The samples of side cameras are not straight, as their steering is corrected.
    straight = np.mean(np.abs(recording.steering) < NEARLY_STRAIGHT) / max(cameras, 1)
    if straight > STRAIGHT_CAP:
        return f"keep data.straight_cap={STRAIGHT_CAP:g}, or "
    return (
        f"data.straight_cap={STRAIGHT_CAP:g} does not act on this recording, because samples of "
        "side cameras are not straight: "
    )


def _no_recoveries(recording: Recording) -> str | None:
    if not np.isfinite(recording.time_s).any():
        return None  # without times no pause can be found
    stretches = find_stretches(recording)
    if not len(stretches.first):
        return None
    after_pause = stretches.first[stretches.after_pause]
    returns = steering_returns(recording, after_pause, stretches.length)
    count = int((returns >= LEAST_CHANGE).sum())
    if count >= RECOVERIES_PER_ROW * len(recording):
        return None
    return (
        f"{count} stretches follow a pause and steer back to the middle: a network learns to "
        "return only from side cameras (data.offset) and augment=[shift]; record recoveries: "
        "pause, drive off the middle, record while you return "
        "(or drivezoo simulator record noise=1)"
    )


def _centre_only(recording: Recording) -> str | None:
    if any(image is not None for image in recording.images[:, 1:].flat):
        return None
    return (
        "no side cameras: data.offset has no effect, and no image shows how to return to the "
        "middle; set augment=[shift], or record with three cameras"
    )


def _no_speed(recording: Recording) -> str | None:
    if not recording.without_speed:
        return None
    return (
        f"the speed is 0 mph in each row of {', '.join(recording.without_speed)}: "
        "data.recover_s and networks that take or predict a speed cannot use it; replay it with "
        "the speed that the car drove: drivezoo replay CKPT FOLDER speed=9"
    )


def _two_speeds(recording: Recording) -> str | None:
    speed = recording.speed_mph
    first = _usual_speed(speed)
    far = speed[np.abs(speed - first) >= SPEEDS_APART_MPH]
    if len(far) < SECOND_SPEED_SHARE * len(speed):
        return None
    second = _usual_speed(far)
    shares = [np.mean(np.abs(speed - one) <= SPEED_WINDOW_MPH / 2) for one in (first, second)]
    if shares[1] < SECOND_SPEED_SHARE or sum(shares) < SPEEDS_SHARE:
        return None
    return (
        f"{shares[0]:.0%} of rows are driven at about {first:.0f} mph, {shares[1]:.0%} at about "
        f"{second:.0f}: one data.offset fits only one speed; set data.recover_s=2, which uses "
        "each row's speed, or record at one speed"
    )


def _usual_speed(speed: np.ndarray) -> float:
    """Return the median of the rows in the fullest window of `SPEED_WINDOW_MPH`."""
    counts = np.bincount(speed.astype(int), minlength=SPEED_WINDOW_MPH)
    least = np.convolve(counts, np.ones(SPEED_WINDOW_MPH), "valid").argmax()
    return float(np.median(speed[(speed >= least) & (speed < least + SPEED_WINDOW_MPH)]))


def _one_direction(recording: Recording) -> str | None:
    total = np.abs(recording.steering).sum()
    if np.count_nonzero(recording.steering) < FEW_TURNS:
        return None
    left = -recording.steering[recording.steering < 0].sum() / total
    if max(left, 1 - left) < SIDE_SHARE:
        return None
    side, share = ("left", left) if left > 0.5 else ("right", 1 - left)
    return (
        f"{share:.0%} of the steering is to the {side}: a network pulls to that side; keep "
        "data.flip=0.5, which mirrors half of the samples, or also record in the other direction"
    )


def _duplicates(recording: Recording) -> str | None:
    named = [path for path in recording.images.flat if path is not None]
    repeated = len(named) - len(set(named))
    if repeated:
        return (
            f"{repeated:,} of {len(named):,} images are named a second time: these rows count "
            "twice and can be in both training and validation; delete the repeated rows of the log"
        )
    same = _identical_to_the_row_before(recording)
    if same < IDENTICAL_SHARE * len(recording):
        return None
    return (
        f"{same:,} of {len(recording):,} centre images repeat the row before's while the car "
        "moves: these rows count twice; end other programs and record again"
    )


def _identical_to_the_row_before(recording: Recording) -> int:
    """Return the number of such rows; only images of equal size are read."""
    centre = recording.images[:, 0]
    size = np.array([_size(path) for path in centre])
    moving = recording.speed_mph[1:] > STANDSTILL_MPH
    alike = np.flatnonzero((size[1:] == size[:-1]) & (size[1:] > 0) & moving)
    return sum(_read(centre[row]) == _read(centre[row + 1]) for row in alike)


def _size(path: str) -> int:
    try:
        return os.stat(path).st_size  # noqa: PTH116 - Path.stat costs three times as much
    except OSError:
        return 0


def _read(path: str) -> bytes:
    with open(path, "rb") as file:  # noqa: PTH123 - Path.open costs twice as much
        return file.read()


_LOOKS: dict[str, Callable[[Recording], str | None]] = {
    "few_rows": _few_rows,
    "keyboard": _keyboard,
    "no_recoveries": _no_recoveries,
    "centre_only": _centre_only,
    "no_speed": _no_speed,
    "two_speeds": _two_speeds,
    "one_direction": _one_direction,
    "duplicates": _duplicates,
}


@dataclass(frozen=True)
class RecordingReport:
    """The figures of a recording, see `report_recording`."""

    name: str
    rows: int
    side_cameras: int
    seconds: float
    fps: float
    gaps: int
    zero_share: float
    mean_speed_mph: float


def report_recordings(recording: Recording) -> list[RecordingReport]:
    """Return a report on each recording; times between recordings are not gaps."""
    return [
        report_recording(recording, recording.recording == number, name)
        for number, name in enumerate(recording.names)
    ]


def report_recording(recording: Recording, mask: np.ndarray, name: str) -> RecordingReport:
    """Return the figures of the rows in `mask`, bool [N].

    `seconds` is the driven time, without gaps; `gaps` counts times over a second between rows;
    `fps` is one over the median time between rows. Without times in the file names `seconds` and
    `fps` are NaN. `side_cameras` counts rows with both side images. `zero_share` is the share of
    rows whose steering is exactly 0: a keyboard gives many.
    """
    steps = np.diff(recording.time_s[mask])
    driven = steps[(steps > 0) & (steps <= GAP_S)]
    images = recording.images[mask]
    return RecordingReport(
        name=name,
        rows=int(mask.sum()),
        side_cameras=sum(None not in row for row in images[:, 1:].tolist()),
        seconds=float(driven.sum()) if len(driven) else float("nan"),
        fps=float(1 / np.median(driven)) if len(driven) else float("nan"),
        gaps=int(((steps > GAP_S) | (steps < 0)).sum()),
        zero_share=float((recording.steering[mask] == 0).mean()) if mask.any() else float("nan"),
        mean_speed_mph=float(recording.speed_mph[mask].mean()) if mask.any() else float("nan"),
    )


def report_lines(recording: Recording) -> list[str]:
    """Return the reports as lines, one per recording, and a line for skipped rows."""
    lines = []
    for report in report_recordings(recording):
        timing = "no times in the file names"
        if np.isfinite(report.seconds):
            gaps = f"{report.gaps} gap{'' if report.gaps == 1 else 's'}"
            timing = f"{report.seconds:.0f} s at {report.fps:.1f} frames/s, {gaps}"
        sides = "3 cameras"
        if report.side_cameras == 0:
            sides = "centre camera only"
        elif report.side_cameras < report.rows:
            sides = f"3 cameras in {report.side_cameras:,} rows"
        lines.append(
            f"{report.name}: {report.rows:,} rows, {sides}, {timing}, "
            f"{report.zero_share:.0%} of steering exactly 0, mean {report.mean_speed_mph:.1f} mph"
        )
    return lines + skipped_lines(recording)


def skipped_lines(recording: Recording) -> list[str]:
    """Return a line for skipped rows, and one for rows with a skipped image."""
    kinds = {"bad rows": recording.bad_rows, "rows with a bad image": recording.bad_images}
    return [
        f"skipped {len(skipped):,} {kind}, the first: {skipped[0]}"
        for kind, skipped in kinds.items()
        if skipped
    ]
