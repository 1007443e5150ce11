"""Figures of a recording, what is unusual about it, and what to do about that."""

import filecmp
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from datamodules.recording import GAP_S, Recording
from datamodules.stretches import LEAST_CHANGE, find_breaks, find_stretches, steering_returns
from zoo.base.rig import RIG_KEYS
from zoo.base.terminal import counted

# The thresholds separate the original's keyboard recording (70 % of steering is 0, the other 798
# rows share 414 values) from the expert's (no 0, as many values as rows).
KEYBOARD_SHARE = 0.4  # share of steering exactly 0
DISTINCT_SHARE = 0.8
# The expert's recordings of recoveries have 6 to 7 in 1,000 rows; with as many normal laps, 3.
RECOVERIES_PER_ROW = 1 / 1000
# A tenth of fewer rows (validation or test) is less than one block of ten seconds: one place.
FEW_ROWS = 1000
SPEED_WINDOW_MPH, SPEEDS_APART_MPH = 3, 6
SPEEDS_SHARE, SECOND_SPEED_SHARE = 0.8, 0.2
SIDE_SHARE = 0.75
FEW_TURNS = 50  # rows with a steering, below which their side is chance
STANDSTILL_MPH = 1.0
IDENTICAL_SHARE = 0.01


@dataclass(frozen=True)
class Finding:
    """An oddity of a recording: its kind, and one line of text for the user."""

    kind: str
    text: str


def find_oddities(recording: Recording) -> list[Finding]:
    """Return what is unusual about a recording; several are judged as one."""
    return [
        Finding(look.__name__.removeprefix("_"), text)
        for look in _LOOKS
        for text in look(recording)
    ]


def _few_rows(recording: Recording) -> Iterator[str]:
    if len(recording) < FEW_ROWS:
        yield (
            f"only {counted(len(recording), 'row')}: validation and test cover one place each, and "
            "a network memorizes the road; record two laps or more (about 2,700 rows), or try with "
            "quick=true"
        )


def _keyboard(recording: Recording) -> Iterator[str]:
    steering = recording.steering
    turned = steering[steering != 0]
    if not len(turned):
        yield (
            "the steering is 0 in each row: there is nothing to learn; record bends, or name the "
            "number that steers (data.steering, or data.columns of a table)"
        )
        return
    share, values = 1 - len(turned) / len(steering), len(np.unique(turned))
    if share > KEYBOARD_SHARE and not 0 < DISTINCT_SHARE * len(turned) <= values:
        yield (
            f"{share:.0%} of steering is exactly 0 and the other {len(turned):,} rows share "
            f"{counted(values, 'value')}, as from a keyboard: a network learns to drive "
            "straight and to jerk; steer by mouse or gamepad (drivezoo simulator drive)"
        )


def _no_recoveries(recording: Recording) -> Iterator[str]:
    if not np.isfinite(recording.time_s).any():
        return  # without times no pause can be found
    stretches = find_stretches(recording)
    returns = steering_returns(recording, stretches.first[stretches.after_pause], stretches.length)
    count = int((returns >= LEAST_CHANGE).sum())
    if len(stretches.first) and count < RECOVERIES_PER_ROW * len(recording):
        yield (
            f"{count} stretches follow a pause and steer back to the middle: a network learns to "
            'return only from side cameras (data.offset) and "augment=[shift]"; record recoveries: '
            "pause, drive off the middle, record while you return "
            "(or drivezoo simulator record noise=1 out=FOLDER)"
        )


def _centre_only(recording: Recording) -> Iterator[str]:
    if all(image is None for image in recording.images[:, 1:].flat):
        yield (
            "no side cameras: data.offset has no effect, and no image shows how to return to the "
            'middle; set "augment=[shift]", or record with three cameras'
        )


def _no_speed(recording: Recording) -> Iterator[str]:
    if unknown := ", ".join(recording.without_speed):
        replay = "; replay it with the speed of the car: drivezoo replay CKPT FOLDER speed=9"
        yield (
            f"the speed of {unknown} is unknown (missing, or 0 in each row): data.recover_s and "
            "networks that take or predict a speed cannot use it"
            f"{'' if recording.without_rig else replay}"
        )


def _no_rig(recording: Recording) -> Iterator[str]:
    if unknown := ", ".join(recording.without_rig):
        yield (
            f"the camera and the car of {unknown} are unknown, so that no replay can score a "
            f"network of it; name a known rig, {RIG_KEYS}, or write one: drivezoo new rig my_car"
        )


def _two_speeds(recording: Recording) -> Iterator[str]:
    if recording.without_speed or all(image is None for image in recording.images[:, 1:].flat):
        return  # no speed to tell apart, or no side camera, and so no offset
    speed = recording.speed_mph
    first = _usual_speed(speed)
    far = speed[np.abs(speed - first) >= SPEEDS_APART_MPH]
    if len(far) < SECOND_SPEED_SHARE * len(speed):
        return
    second = _usual_speed(far)
    shares = [np.mean(np.abs(speed - peak) <= SPEED_WINDOW_MPH / 2) for peak in (first, second)]
    if shares[1] >= SECOND_SPEED_SHARE and sum(shares) >= SPEEDS_SHARE:
        by_rig = "set data.recover_s=2, which uses each row's speed, or "
        yield (
            f"{shares[0]:.0%} of rows are driven at about {first:.0f} mph, {shares[1]:.0%} at "
            f"about {second:.0f}: one data.offset fits only one speed; "
            f"{'' if recording.without_rig else by_rig}record at one speed"
        )


def _usual_speed(speed: np.ndarray) -> float:
    """Return the median of the rows in the fullest window of `SPEED_WINDOW_MPH`."""
    counts = np.bincount(speed.astype(int), minlength=SPEED_WINDOW_MPH)
    least = np.convolve(counts, np.ones(SPEED_WINDOW_MPH), "valid").argmax()
    return float(np.median(speed[(speed >= least) & (speed < least + SPEED_WINDOW_MPH)]))


def _one_direction(recording: Recording) -> Iterator[str]:
    total = np.abs(recording.steering).sum()
    if np.count_nonzero(recording.steering) < FEW_TURNS:
        return
    left = -recording.steering[recording.steering < 0].sum() / total
    side, share = ("left", left) if left > 0.5 else ("right", 1 - left)
    if share >= SIDE_SHARE:
        yield (
            f"{share:.0%} of the steering is to the {side}: a network pulls to that side; keep "
            "data.flip=0.5, which mirrors half of the samples, or also record in the other "
            "direction"
        )


def _backward_times(recording: Recording) -> Iterator[str]:
    # An edited recording's mirrored and merged rows follow an empty line, whatever their times.
    follows = (np.diff(recording.recording) == 0) & (np.diff(recording.line) == 1)
    rows = np.flatnonzero(follows & (np.diff(recording.time_s) < 0)) + 1
    if len(rows):
        yield (
            f"{recording.place(rows[0])}: its time is before the row above's ({len(rows):,} such "
            "rows): each is taken for a pause, at which windows and drives end; sort the rows by "
            "time, unless the clock was set back, as at the end of summer time"
        )


def _duplicates(recording: Recording) -> Iterator[str]:
    # Hard links, as those of an edited copy, share the number and the disk of a file.
    named = [
        Path(image).stat()[1:3] if isinstance(image, str) and Path(image).exists() else image
        for image in recording.images.flat
        if image is not None
    ]
    if repeated := len(named) - len(set(named)):
        yield (
            f"{repeated:,} of {len(named):,} images are named a second time: these rows count "
            "twice and can be in both training and validation; delete the repeats, or name one copy"
        )
        return
    first: dict[str, str] = {}
    for name, part in zip(recording.names, recording.recordings, strict=True):
        digest = replace(part, recording=0 * part.recording).fingerprint()
        if len(part) and (other := first.setdefault(digest, name)) != name:
            yield f"{name} is a copy of {other}: its rows count twice; name one of them"
            return
    centre, moving = recording.images[:, 0], recording.speed_mph[1:] > STANDSTILL_MPH
    same = sum(_is_copy(centre[row], centre[row + 1]) for row in np.flatnonzero(moving))
    if same >= IDENTICAL_SHARE * len(recording):
        yield (
            f"{same:,} of {len(recording):,} centre images repeat the row before's while the car "
            "moves: these rows count twice; end other programs and record again"
        )


def _is_copy(path: object, other: object) -> bool:
    """Return whether two files have the same contents; only files of equal size are read."""
    if isinstance(path, str) and isinstance(other, str):  # a video's frames are not compared
        with suppress(OSError):
            return filecmp.cmp(path, other, shallow=False)
    return False


_LOOKS: tuple[Callable[[Recording], Iterator[str]], ...] = (
    _few_rows,
    _keyboard,
    _no_recoveries,
    _centre_only,
    _no_speed,
    _no_rig,
    _two_speeds,
    _one_direction,
    _backward_times,
    _duplicates,
)


@dataclass(frozen=True)
class RecordingReport:
    """The figures of a recording.

    Attributes:
        name: folder of the recording.
        rows: number of rows.
        side_cameras: rows with both side images.
        seconds: driven time, without gaps; NaN without times, or of one.
        fps: rows of a second, without gaps; NaN without times.
        gaps: times over a second between rows.
        zero_share: share of rows whose steering is exactly 0: a keyboard gives many.
        mean_speed_mph: mean of the speed; NaN if it is unknown.
    """

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
    return list(map(_report, recording.recordings, recording.names))


def _report(recording: Recording, name: str) -> RecordingReport:
    steps = np.diff(recording.time_s)
    driven = steps[(steps >= 0) & (steps <= GAP_S)]
    return RecordingReport(
        name=name,
        rows=len(recording),
        side_cameras=sum(None not in row for row in recording.images[:, 1:].tolist()),
        seconds=float(driven.sum()) if driven.any() else float("nan"),
        fps=float(1 / driven.mean()) if driven.any() else float("nan"),
        gaps=int(find_breaks(recording).sum()),
        zero_share=float((recording.steering == 0).mean()) if len(recording) else float("nan"),
        mean_speed_mph=float(recording.known_speed_mph.mean()) if len(recording) else float("nan"),
    )


def report_lines(recording: Recording) -> list[str]:
    """Return the reports as lines, one per recording, and a line for skipped rows."""
    lines = []
    for report in report_recordings(recording):
        timing = "driven time unknown"
        if np.isfinite(report.seconds):
            gaps = counted(report.gaps, "gap")
            timing = f"{report.seconds:.0f} s at {report.fps:.1f} frames/s, {gaps}"
        mph = report.mean_speed_mph
        speed = "speed unknown" if np.isnan(mph) else f"mean {mph:.1f} mph"
        seen = report.side_cameras
        some = f" in {counted(seen, 'row')}" if seen < report.rows else ""
        sides = f"3 cameras{some}" if report.side_cameras else "centre camera only"
        lines.append(
            f"{report.name}: {counted(report.rows, 'row')}, {sides}, {timing}, "
            f"{report.zero_share:.0%} of steering exactly 0, {speed}"
        )
    return [*lines, *recording.notes, *skipped_lines(recording)]


def skipped_lines(recording: Recording) -> list[str]:
    """Return a line for skipped rows, and one for rows with a skipped image."""
    kinds = {"a bad value": recording.bad_rows, "a bad image": recording.bad_images}
    return [
        f"skipped {counted(len(skipped), 'row')} with {kind}, the first: {skipped[0]}"
        for kind, skipped in kinds.items()
        if skipped
    ]
