"""Recordings whose labels stand in a table beside images or a video: what their formats share."""

import itertools
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
    IMAGE,
    BadRows,
    forget_half_written,
    printable_path,
    read_fields,
    replace_undecoded,
    without_empty,
)
from datamodules.format_options import ReadOptions
from datamodules.formats.udacity import image_finder
from datamodules.looking.sign_evidence import find_sign_evidence
from datamodules.recording import (
    SHORT_DRIVES,
    Blocks,
    Recording,
    keep_valid,
    make_recording,
    unnamed_note,
)
from datamodules.steering_unit import EXAMPLE, SteeringUnit
from zoo.base.errors import InputError, library_errors
from zoo.base.limits import check_most
from zoo.base.rig import MPS_PER_MPH, Rig

MOST_ASIDE = 0.5  # middle of the steering numbers, as a share of full lock
DATE = re.compile(r"\d+[-/]\d+[-/]\d")
NUMBERS = ("time_s", "speed_mps", "throttle", "brake")

Rows = dict[str, list]  # columns by name


def collect(
    records: Iterable[tuple[str, Any]], parse: Callable[[Any], dict[str, Any]], bad: BadRows
) -> Rows:
    """Return columns of what `parse` returns for each row, `place`, and its number as `line`.

    Args:
        records: place, which ends with the row's number, and content of each row.
        parse: function from a row's content to its values; it raises InputError or ValueError
            for a bad row.
        bad: collector of bad rows.
    """
    rows: Rows = {"place": [], "line": [], "steering": [], "center": []}
    for source, content in records:
        try:
            values = parse(content)
        except (InputError, ValueError) as error:
            bad.faults.append(f"{source}: {error}")
            continue
        for name, value in values.items():
            rows.setdefault(name, []).append(value)
        rows["place"].append(source)
        rows["line"].append(int(source.rpartition(" ")[2]))
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
            them `time_s`, `speed_mps`, `throttle`, `brake`; and `line`, the row's number, where a
            missing number is a missing frame.
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
    _check_range(folder, written, meant, is_stated, is_said=options.unit is not None)
    numbers = {name: np.array(rows[name], float) for name in NUMBERS if name in rows}
    if "speed_mps" in numbers:
        numbers["speed_mph"] = np.abs(numbers.pop("speed_mps")) / MPS_PER_MPH
    recording = make_recording(
        folder,
        numbers | {"steering": meant.steering(written)},
        {camera: rows[camera] for camera in CAMERAS if camera in rows},
        places=np.array(rows["place"], object),
        line=np.array(rows.get("line", range(1, len(written) + 1))),
        rig=_with_full_lock(rig, unit, meant),
        units=(meant,),
        notes=notes,
        blocks=blocks,
    )
    recording = _with_images(recording, options)
    left_out = len(CAMERAS) * (len(bad.faults) + len(recording.bad_images))
    files = {os.path.dirname(image) for image in recording.images[:, 0] if isinstance(image, str)}  # noqa: PTH120
    bad.notes += unnamed_note(files, recording.images, left_out)
    recording = keep_valid(recording, bad)
    if options.unit or is_stated:  # `check` compares it with the images
        source = "data.steering says" if options.unit else "the format states"
        note = f"steering: {meant.words()}, as {source}"
    else:
        note = _agreement(folder, recording, meant)
    return replace(recording, notes=(note, *recording.notes))


def _with_full_lock(rig: Rig | None, stated: SteeringUnit, meant: SteeringUnit) -> Rig | None:
    """Return the rig with the user's full lock; None of numbers in another unit than its car's."""
    if rig is None or meant.unit != stated.unit:
        return None
    return replace(rig, steering_deg=rig.steering_deg * meant.full / stated.full)


def _check_range(
    folder: Path, written: np.ndarray, unit: SteeringUnit, is_stated: bool, is_said: bool
) -> None:
    """Raise InputError for numbers that cannot be in a unit.

    Args:
        folder: folder of the recording.
        written: numbers of the format, float64 [N].
        unit: unit that they are taken for.
        is_stated: whether the format states the unit, so that a drive may have no straight moment.
        is_said: whether the user states it, so that a drive may be a single bend.
    """
    finite = written[np.isfinite(written)]
    if not len(finite):
        return
    steering = unit.steering(finite)
    beyond = np.abs(steering) > 1
    if len(np.unique(steering[beyond])) == 1 and steering[~beyond].any():
        steering = steering[~beyond]  # one number that marks rows, which `keep_valid` names
    # Of few rows, these leave out the largest and the smallest: one bad row is not the unit's.
    low = np.percentile(steering, 1, method="higher")
    high = np.percentile(steering, 99, method="lower")
    fits = max(-low, high) <= 1
    is_centred = abs(np.median(steering)) <= MOST_ASIDE and (is_stated or low <= 0 <= high)
    if fits and (is_centred or is_said):
        return
    fault = f"not {unit.words()}; name what they are,"
    if fits:
        fault = (
            f"all on one side of {unit.zero:g}, so that nothing shows which number steers straight "
            f'on; for a clip of one bend name "data.{unit.key()}",'
        )
    raise InputError(
        f"{folder}: the steering numbers are {finite.min():g}..{finite.max():g}, mostly about "
        f"{np.median(finite):g}: {fault} for a servo "
        '"data.steering={unit: servo, zero: 90, full: 45, right: positive}", for a steering wheel '
        f'"data.steering={{{EXAMPLE}}}"'
    )


def _agreement(folder: Path, recording: Recording, unit: SteeringUnit) -> str:
    """Return a line on a unit and the images' evidence; raise InputError if they do not fit."""
    evidence = find_sign_evidence(recording)
    if evidence.is_clear and evidence.correlation > 0:
        return f"steering: {unit.words()}, as the images show ({evidence.words()})"
    if not evidence.is_clear:  # of images that cannot be read nothing is
        with library_errors(recording.place(0), "its image is bad", "copy the images again"):
            recording.image(0)
    turned = replace(unit, right="positive" if unit.right == "negative" else "negative")
    what, likely = ("deny", turned) if evidence.is_clear else ("do not settle", unit)
    raise InputError(
        f"{folder}: the format does not say what its steering is, and the images {what} that it is "
        f"{unit.words()} ({evidence.words()}); look at them, and name what is right, such as "
        f'"data.{likely.key()}"'
    )


def _with_images(recording: Recording, options: ReadOptions) -> Recording:
    """Return the rows whose centre image exists, wherever the folder was moved to.

    A missing side image is none.
    """
    find, begin = image_finder(Path(recording.names[0])), f"{recording.names[0]}{os.sep}"

    def existing(image: object) -> object:
        # Of the current folder, ".", an image's path says nothing.
        return find(image.removeprefix(begin)) if isinstance(image, str) else image

    recording.images[:] = np.frompyfunc(existing, 1, 1)(recording.images)
    has_image = recording.images[:, 0].astype(bool)
    missing = [
        f"{recording.place(row)}: no centre image" for row in np.flatnonzero(~has_image).tolist()
    ]
    options.check_images(missing, len(recording))
    return recording.keep(has_image, tuple(missing))


def read_csv(
    path: Path, columns: Sequence[str], bad: BadRows
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield each row's place and its fields by the header's names.

    A last row that is cut short before its line's end is left out: a program is still writing it.

    Args:
        path: CSV file with a header, or with columns that are named by their positions, from 0.
        columns: names of columns that must be there.
        bad: collector of rows with another number of fields.

    Raises:
        InputError: the header lacks a column or names one twice.
    """
    rows = read_fields(path, bad)
    first = next(rows, (1, []))
    names = without_empty(first[1])
    header, what = [replace_undecoded(name) for name in names], "the header {}"
    if any(map(IMAGE.search, names)):  # a row: columns are named by their positions
        rows, header = itertools.chain([first], rows), [str(at) for at in range(len(header))]
        names, what = [], "a table without a header, of columns {},"
    elif lacking := {name for name in columns if name not in header and name.isdigit()}:
        header = [str(at) if str(at) in lacking else name for at, name in enumerate(header)]
    for fault, faulty in (
        ("has no column", [name for name in columns if name not in header]),
        ("has twice", [name for name in columns if header.count(name) > 1]),
    ):
        if faulty:
            raise InputError(
                f"{path}, row 1: {what.format(','.join(header)):.200} {fault} {', '.join(faulty)}; "
                "name its columns, or another file"
            )
    fields = header
    for line, fields in rows:
        check_most("rows", line, path, "divide the recording")
        fields = without_empty(fields, len(header))
        if fields == names:
            bad.notes.append(f"{path.name}: row {line} repeats the header, and is left out")
        elif len(fields) == len(header):
            yield f"{path}, row {line}", dict(zip(header, fields, strict=True))
        else:
            bad.faults.append(f"{path}, row {line}: {len(fields)} columns, expected {len(header)}")
    if len(fields) < len(header):
        forget_half_written(path, bad)


def decimal(fields: Mapping[str, Any], name: str) -> float:
    """Return the number in a field, which may have a decimal comma.

    Raises:
        ValueError: the field has no finite number.
    """
    field = fields[name]
    try:
        value = float(field.replace(",", ".") if isinstance(field, str) else field)
    except (ValueError, TypeError):  # Parquet's empty cells are None
        value = math.nan
    if math.isfinite(value):
        return value
    what = "seconds: convert dates" if DATE.match(str(field)) else "a finite number"
    raise ValueError(f"{name} is {field!r:.80}, not {what}")


def inside(folder: Path, name: str) -> str:
    """Return the path within a folder of a file that a table names.

    It may have been written on any system. Of an absolute path, which is another machine's, the
    last parts may lead to the file: see `image_finder`.

    Raises:
        ValueError: the name leads out of the folder, or is not UTF-8.
    """
    local = re.sub(r"^[A-Za-z]:[\\/]", "", printable_path(name))
    parts = [part for part in re.split(r"[\\/]", local) if part not in ("", ".")]
    if not parts or ".." in parts or ":" in local or "\0" in name:
        raise ValueError(f"the image {name!r:.80} is no path within the folder")
    return str(folder.joinpath(*parts))
