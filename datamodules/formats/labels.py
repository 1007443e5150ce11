"""Recordings whose labels stand in a table beside images or a video: what their formats share."""

import functools
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import (
    CAMERAS,
    BadRows,
    forget_half_written,
    read_fields,
    replace_undecoded,
)
from datamodules.formats.video import read_frames
from datamodules.image import StoredImage
from datamodules.read_options import ReadOptions
from datamodules.recording import (
    SHORT_DRIVES,
    Blocks,
    ForwardReader,
    Recording,
    keep_valid,
    list_files,
    make_recording,
)
from datamodules.sign_evidence import find_sign_evidence
from datamodules.steering_unit import EXAMPLE, SteeringUnit
from zoo.base.errors import InputError
from zoo.base.limits import check_most
from zoo.base.rig import MPS_PER_MPH, Rig

MOST_ASIDE = 0.5  # middle of the steering numbers, as a share of full lock
NUMBERS = ("time_s", "speed_mps", "throttle", "brake")

Rows = dict[str, list]  # columns by name


def collect(
    found: Iterable[tuple[str, Any]], parse: Callable[[Any], dict[str, Any]], bad: BadRows
) -> Rows:
    """Return columns of what `parse` returns for each row, and `place`.

    Args:
        found: place and content of each row.
        parse: function from a row's content to its values; it raises ValueError for a bad row.
        bad: collector of bad rows.
    """
    rows: Rows = {"place": [], "steering": [], "center": []}
    for place, content in found:
        try:
            values = parse(content)
        except ValueError as error:
            bad.faults.append(f"{place}: {error}")
            continue
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
        rows["place"].append(place)
    return rows


def labelled_recording(
    folder: Path,
    rows: Rows,
    unit: SteeringUnit,
    options: ReadOptions,
    bad: BadRows | None = None,
    *,
    is_stated: bool = True,
    rig: Rig | None = None,
    notes: tuple[str, ...] = (),
    blocks: Blocks = SHORT_DRIVES,
) -> Recording:
    """Return a recording from its rows; its images are checked, and the steering's meaning.

    Args:
        folder: folder of the recording.
        rows: columns by name: `place` (file and row), `steering` in the format's unit, images
            `center`, `left`, `right` (a path, a `StoredImage` or None), and where the format has
            them `time_s`, `speed_mps`, `throttle`, `brake`.
        unit: what the steering's numbers mean, unless `options` say otherwise.
        options: what the user says about the recording.
        bad: collector of bad rows; None if all could be read.
        is_stated: whether the format states the unit and the sign; otherwise the images must agree.
        rig: cameras and car.
        notes: lines on what was left out or inferred.
        blocks: blocks of a split by time.

    Raises:
        InputError: a row is bad, an image is missing, no row is left, or the steering does not
            mean what the format or the user says.
    """
    bad = bad or BadRows(options.on_bad_row)
    if not rows["place"]:
        bad.finish(0)
        raise InputError(f"{folder}: the recording has no rows; record some driving first")
    check_most("rows", len(rows["place"]), folder, "divide the recording")
    written = np.array(rows["steering"], float)
    meant = options.unit or unit
    _check_range(folder, written, meant, never_straight=is_stated or options.unit is not None)
    numbers = {name: np.array(rows[name], float) for name in NUMBERS if name in rows}
    if "speed_mps" in numbers:
        numbers["speed_mph"] = np.abs(numbers.pop("speed_mps")) / MPS_PER_MPH
    recording = make_recording(
        folder,
        numbers | {"steering": meant.steering(written)},
        {camera: rows[camera] for camera in CAMERAS if camera in rows},
        places=np.array(rows["place"], object),
        rig=_with_full_lock(rig, unit, meant),
        notes=notes,
        blocks=blocks,
    )
    recording = keep_valid(_with_images(recording, options), bad)
    if options.unit:
        note = f"steering: {meant.words()}, as data.steering says"
    elif is_stated:  # `check` compares it with the images
        note = f"steering: {meant.words()}, as the format states"
    else:
        note = _agreement(folder, recording, meant)
    return replace(recording, notes=(note, *recording.notes))


def _with_full_lock(rig: Rig | None, stated: SteeringUnit, meant: SteeringUnit) -> Rig | None:
    """Return the rig with the user's full lock; None of numbers in another unit than its car's."""
    if rig is None or meant.unit != stated.unit:
        return None
    return replace(rig, steering_deg=rig.steering_deg * meant.full / stated.full)


def _check_range(
    folder: Path, written: np.ndarray, unit: SteeringUnit, never_straight: bool
) -> None:
    """Raise InputError for numbers that cannot be in a unit.

    Args:
        folder: folder of the recording.
        written: numbers of the format, float64 [N].
        unit: unit that they are taken for.
        never_straight: whether a drive without a straight moment is possible.
    """
    known = written[np.isfinite(written)]
    if not len(known):
        return
    steering = unit.steering(known)
    # Of few rows, these leave out the largest and the smallest: one bad row is not the unit's.
    low = np.percentile(steering, 1, method="higher")
    high = np.percentile(steering, 99, method="lower")
    middle = np.median(steering)
    is_straight = never_straight or low <= 0 <= high
    if max(-low, high) <= 1 and abs(middle) <= MOST_ASIDE and is_straight:
        return
    raise InputError(
        f"{folder}: the steering numbers are {known.min():g}..{known.max():g}, mostly about "
        f"{np.median(known):g}: not {unit.words()}; name what they are, for a servo "
        "'data.steering={unit: servo, zero: 90, full: 45, right: positive}', for a steering wheel "
        f"'data.steering={{{EXAMPLE}}}'"
    )


def _agreement(folder: Path, recording: Recording, unit: SteeringUnit) -> str:
    """Return a line on a unit and the images' evidence; raise InputError if they do not fit."""
    evidence = find_sign_evidence(recording)
    if evidence.is_clear and evidence.correlation > 0:
        return f"steering: {unit.words()}, as the images show ({evidence.words()})"
    what = "deny" if evidence.is_clear else "do not settle"
    raise InputError(
        f"{folder}: the format does not say what its steering is, and the images {what} that it is "
        f"{unit.words()} ({evidence.words()}); look at them, and name what is right, such as "
        f"'data.{unit.key()}'"
    )


def _with_images(recording: Recording, options: ReadOptions) -> Recording:
    """Return the rows whose centre image exists; a missing side image is none."""
    files = functools.cache(list_files)

    def exists(image: object) -> bool:
        if not isinstance(image, str):
            return image is not None
        folder, name = os.path.split(image)
        return name in files(folder)

    found = np.frompyfunc(exists, 1, 1)(recording.images).astype(bool)
    recording.images[~found] = None
    rows = np.flatnonzero(~found[:, 0]).tolist()
    missing = [f"{recording.place(row)}: no centre image" for row in rows]
    if missing and (options.on_bad_image == "fail" or len(missing) == len(recording)):
        raise InputError(
            f"{missing[0]} ({len(missing):,} of {len(recording):,} rows lack one); copy the images "
            "there, or set data.on_bad_image=skip"
        )
    return recording.keep(found[:, 0], tuple(missing))


def read_csv(
    path: Path, columns: Sequence[str], bad: BadRows
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield each row's place and its fields by the header's names.

    A last row that is cut short before its line's end is left out: a program is still writing it.

    Args:
        path: CSV file with a header.
        columns: names of columns that must be there.
        bad: collector of rows with another number of fields.

    Raises:
        InputError: the header lacks a column or names one twice.
    """
    rows = read_fields(path, bad.faults)
    header = [replace_undecoded(name) for name in next(rows, (1, []))[1]]
    for fault, names in (
        ("has no column", [name for name in columns if name not in header]),
        ("has twice", [name for name in columns if header.count(name) > 1]),
    ):
        if names:
            raise InputError(
                f"{path}, row 1: the header {','.join(header):.200} {fault} {', '.join(names)}; "
                "correct it, or name another file"
            )
    fields = header
    for line, fields in rows:
        check_most("rows", line, path, "divide the recording")
        if len(fields) == len(header):
            yield f"{path}, row {line}", dict(zip(header, fields, strict=True))
        else:
            bad.faults.append(f"{path}, row {line}: {len(fields)} columns, expected {len(header)}")
    if len(fields) < len(header):
        forget_half_written(path, bad)


def decimal(fields: Mapping[str, Any], name: str) -> float:
    """Return the number in a field.

    Raises:
        ValueError: the field has no finite number.
    """
    try:
        value = float(fields[name])
    except (ValueError, TypeError):  # Parquet's empty cells are None
        value = math.nan
    if math.isfinite(value):
        return value
    raise ValueError(f"{name} is {fields[name]!r:.80}, not a finite number")


def inside(folder: Path, name: str) -> str:
    """Return the path of a file that a table names; it may have been written on any system.

    Raises:
        ValueError: the name leads out of the folder.
    """
    parts = [part for part in re.split(r"[\\/]", name) if part not in ("", ".")]
    if not parts or ".." in parts or name[:1] in ("/", "\\") or ":" in name or "\0" in name:
        raise ValueError(f"the image {name!r:.80} is no path within the folder")
    return str(folder.joinpath(*parts))


def video_images(video: Path) -> Callable[[int], StoredImage]:
    """Return a function from a frame's number, from 0, to the image in a video."""
    reader = ForwardReader(lambda file: read_frames(Path(file)))
    return lambda number: StoredImage(str(video), number, reader)
