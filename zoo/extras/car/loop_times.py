"""Measured times of a driving loop: a CSV file, Donkeycar's profile, or a drive of drivezoo."""

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zoo.base.bounded_files import read_text
from zoo.base.errors import InputError, UsageError, hint
from zoo.driving.drive_log import LOG_NAME, read_drive

LATENCY, LOOP, LOST = "latency_ms", "loop_ms", "lost"
LONGEST_MS = 5000.0  # a pause of the program, not a delay of its loop
SHORTEST_MS = 20.0  # step of the simulated car
MOST_BYTES = 16_000_000
MOST_TIMES = 20_000
SECONDS_BELOW_MS = 1.0  # median of a table that was typed in seconds
PROFILE = "99.9%"  # heading of the last column of Donkeycar's table
# Classes of Donkeycar's parts that run a network, but not UserPilotCondition.
PILOT = re.compile("(?!.*condition)(keras|tensorrt|onnx|torch|fastai|resnet|.*pilot)", re.I)
DRAWN = 1000  # times drawn from a profile
# Shares of the times below the columns of Donkeycar's table; its maximum is that of many times.
QUANTILES = {"min": 0.0, "50%": 0.5, "90%": 0.9, "99%": 0.99, "99.9%": 0.999, "max": 1.0}


@dataclass(frozen=True)
class LoopTimes:
    """Times of a loop that takes a frame, steers, and takes the next frame.

    Attributes:
        name: file that they come from.
        loop_ms: milliseconds from each frame to the next, float [N].
        latency_ms: milliseconds from each frame to the arrival of its steering, float [N]; NaN for
            a lost frame.
        lost: whether each frame got lost, so that the steering stays as it was, bool [N].
        words: how the times were read.
    """

    name: str
    loop_ms: np.ndarray
    latency_ms: np.ndarray
    lost: np.ndarray
    words: str = ""

    @property
    def rate_hz(self) -> float:
        """Return the mean number of frames per second that are steered by."""
        return 1000 * float((~self.lost).sum() / self.loop_ms.sum())

    @property
    def delay_ms(self) -> float:
        """Return the mean milliseconds from a frame that is not lost to its steering."""
        return float(self.latency_ms[~self.lost].mean())

    @property
    def loop(self) -> tuple[tuple[float, float], ...]:
        """Return the loop of a simulated `World`: a lost frame lengthens the one before."""
        kept = np.flatnonzero(~self.lost)
        periods = np.add.reduceat(np.roll(self.loop_ms, -kept[0]), kept - kept[0])
        pairs = zip(periods / 1000, self.latency_ms[kept] / 1000, strict=True)
        return tuple((float(period), float(latency)) for period, latency in pairs)

    def improved(self) -> dict[str, "LoopTimes"]:
        """Return the times with one property improved at a time, by what was done."""
        loop_ms, latency_ms, lost = self.loop_ms, self.latency_ms, self.lost

        def changed(loop_ms: np.ndarray, latency_ms: np.ndarray) -> LoopTimes:
            return LoopTimes(self.name, np.maximum(loop_ms, SHORTEST_MS), latency_ms, lost)

        improved = {
            "half the delay": changed(loop_ms, latency_ms / 2),
            "twice the frame rate": changed(loop_ms / 2, latency_ms),
            "both": changed(loop_ms / 2, latency_ms / 2),
        }
        if np.ptp(loop_ms) > 0 or np.ptp(latency_ms[~lost]) > 0:
            steady = np.full_like(loop_ms, loop_ms.mean()), np.full_like(loop_ms, self.delay_ms)
            improved["no jitter"] = changed(*steady)
        if lost.any():
            # A lost frame takes as long as the last one before it that arrived.
            kept = np.flatnonzero(~lost)
            whole = latency_ms[kept[np.searchsorted(kept, np.arange(len(lost)), "right") - 1]]
            improved["no lost frames"] = LoopTimes(self.name, loop_ms, whole, np.zeros_like(lost))
        return improved


def read_loop_times(path: str, rate: float, part: str | None = None) -> LoopTimes:
    """Read the times of a loop.

    A CSV file has a column `latency_ms`, or one column without a name; `lost` in place of a number
    marks a frame that got lost. Without a column `loop_ms` the loop waits until `1 / rate` seconds
    have passed, as Donkeycar's does. From Donkeycar's table, which has quantiles only, times of the
    pilot are drawn between them, and the means of the other parts are added. Where no part, or more
    than one, is a pilot by its name, the one with the largest mean is taken.

    Args:
        path: CSV file, Donkeycar's printed table, or folder of a drive.
        rate: frames per second that the loop is set to.
        part: row of Donkeycar's table; None for the pilot.

    Raises:
        InputError: the file cannot be read, or a time is not possible.
        UsageError: there is no such part.
    """
    file = Path(path).expanduser()
    if (file / LOG_NAME).exists():
        return _of_drive(file)
    text = read_text(file, MOST_BYTES)
    if PROFILE in text:
        return _of_profile(path, text, rate, part)
    if part is not None:
        raise UsageError(f"part={part}: {path} is no table of Donkeycar's profiler; drop part=")
    return _of_table(path, text, rate)


def _of_drive(folder: Path) -> LoopTimes:
    """Return the times of the one client of a drive."""
    drive = read_drive(folder)
    latency_ms, loop_ms = drive.latency_ms[:-1], 1000 * np.diff(drive.time_s)
    usable = (loop_ms > 0) & (loop_ms <= LONGEST_MS) & ~np.isnan(latency_ms)
    if not usable.any():
        raise InputError(f"{folder / LOG_NAME}: holds no latency_ms; name a drive on a socket")
    words = f"{usable.sum():,} replies of a drive"
    return _checked(str(folder), loop_ms[usable], latency_ms[usable], words=words)


def _of_table(path: str, text: str, rate: float) -> LoopTimes:
    try:
        rows = list(csv.reader(io.StringIO(text), strict=True))
    except csv.Error as error:
        raise InputError(f"{path}: is no CSV file ({error}); name a table of times") from None
    names, first = [LATENCY], 1
    if rows and not _is_time(rows[0][0] if rows[0] else ""):
        names, rows, first = [cell.strip() for cell in rows[0]], rows[1:], 2
        if LATENCY not in names:
            raise InputError(
                f"{path}: has no column {LATENCY}, only {', '.join(names)[:80]}; name the column "
                f"of milliseconds {LATENCY}, and that of a whole loop {LOOP}"
            )
    while rows and not any(rows[-1]):  # a file's last lines may be empty
        rows.pop()
    if not 0 < len(rows) <= MOST_TIMES:
        raise InputError(f"{path}: has {len(rows):,} times; keep 1 to {MOST_TIMES:,}")
    columns: dict[str, list[float]] = {LATENCY: [], LOOP: []}
    for line, row in enumerate(rows, first):
        if len(row) > len(names):
            raise InputError(
                f"{path}, row {line}: has {len(row)} columns, expected {', '.join(names)}; name "
                f"each in the first row, such as {LATENCY},{LOOP}"
            )
        for name, values in columns.items():
            if name in names:
                cell = row[names.index(name)] if len(row) == len(names) else ""
                values.append(_milliseconds(f"{path}, row {line}", name, cell))
    latency_ms, loop_ms = np.array(columns[LATENCY]), np.array(columns[LOOP])
    lost = np.isnan(latency_ms)
    for name, times in ((LATENCY, latency_ms[~lost]), (LOOP, loop_ms)):
        if times.size and 0 < (median := float(np.median(times))) < SECONDS_BELOW_MS:
            raise InputError(
                f"{path}: {name} is {median:g} in the median, as of seconds; write milliseconds "
                f"({1000 * median:g}), or latency_ms 0 for a delay that is shorter than one"
            )
    if LOOP not in names:
        loop_ms = np.fmax(latency_ms, 1000 / rate)
    words = f"{len(rows):,} times" + (f", of which {lost.sum():,} lost" if lost.any() else "")
    return _checked(path, loop_ms, latency_ms, lost, words)


def _of_profile(path: str, text: str, rate: float, part: str | None) -> LoopTimes:
    rows = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in text.splitlines()
        if line.strip().startswith("|")
    ]
    header = next(number for number, row in enumerate(rows) if PROFILE in row)
    names = rows[header]
    parts: dict[str, dict[str, float]] = {}
    for row in rows[header + 1 :]:
        label = f"{path}, part {row[0][:40]}"
        if len(row) != len(names):
            raise InputError(f"{label}: has {len(row)} columns, expected {len(names)}")
        cells = dict(zip(names[1:], row[1:], strict=True))
        named = {name: _milliseconds(label, name, cell) for name, cell in cells.items()}
        if missing := {"avg", *QUANTILES} - set(named):
            raise InputError(f"{path}: its table lacks the column {min(missing)}; copy it whole")
        # Two parts of one class have one name; the loop waits for both.
        parts[row[0] if row[0] not in parts else f"{row[0]} {len(parts)}"] = named
    if not parts:
        raise InputError(f"{path}: its table has no parts; copy it whole")
    chosen = "as part= says"
    if part is None:
        pilots = [name for name in parts if PILOT.match(name)]
        part = max(pilots or parts, key=lambda name: parts[name]["avg"])
        why = "a pilot by its name" if len(pilots) == 1 else "the longest pilot by its name"
        chosen = why if pilots else "no pilot by its name, but the longest; part=NAME names another"
    elif part not in parts:
        raise UsageError(f"part={part}: no such part; {hint(part, parts)}")
    pilot = parts[part]
    others_ms = sum(times["avg"] for name, times in parts.items() if name != part)
    shares = np.random.default_rng(0).permutation((np.arange(DRAWN) + 0.5) / DRAWN)
    points = np.maximum.accumulate([pilot[name] for name in QUANTILES])
    latency_ms = others_ms + np.interp(shares, list(QUANTILES.values()), points)
    loop_ms = np.maximum(latency_ms, 1000 / rate)
    words = f"Donkeycar's profile: {part} ({chosen}) and {others_ms:.1f} ms of the other parts"
    return _checked(path, loop_ms, latency_ms, words=words)


def _checked(
    name: str,
    loop_ms: np.ndarray,
    latency_ms: np.ndarray,
    lost: np.ndarray | None = None,
    words: str = "",
) -> LoopTimes:
    """Return times whose loops are as long as a step of the simulated car, or longer."""
    lost = np.zeros(len(loop_ms), bool) if lost is None else lost
    if lost.all():
        raise InputError(f"{name}: all frames are {LOST}; name a table with times")
    return LoopTimes(name, np.maximum(loop_ms, SHORTEST_MS), latency_ms, lost, words)


def _is_time(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell.strip() == LOST
    return True


def _milliseconds(label: str, name: str, cell: str) -> float:
    """Return a time; NaN for a lost frame."""
    cell = cell.strip()
    if cell == LOST and name == LATENCY:
        return float("nan")
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if 0 <= value <= LONGEST_MS and (value > 0 or name != LOOP):
        return value
    if cell and value > LONGEST_MS:
        fix = "delete the row: a program that pauses this long is not driving"
    else:
        fix = f"write milliseconds, or {LOST} for a frame that got lost"
    raise InputError(f"{label}: {name} is {cell[:40]!r}; {fix}")
