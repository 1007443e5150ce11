"""A person's corrections: a recording of them, or a drive in which the person took over.

The simulator's telemetry is empty while a person holds W or S: no image, no steering. A drive has
the times of these takeovers and the network's frames and steering before them, but not what the
person did. So the person is asked, as DAgger asks its expert: `labels.csv` lists frames before each
takeover with the network's steering, and the person writes the correct steering.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from datamodules.driving_log import CAMERAS, BadRows, read_fields, read_log
from datamodules.formats.recording_writer import image_stems, put_image, write_log
from datamodules.image import read_image
from datamodules.recorded_car import read_source, write_car, write_rig_of
from datamodules.recording import IMAGE_FOLDER, LOG_NAME
from datamodules.recording_format import read_recordings
from datamodules.stretches import complete_times, missing_rows
from zoo.base.errors import InputError
from zoo.base.file_text import csv_text
from zoo.base.new_folder import whole_folder
from zoo.base.rig_file import find_rig
from zoo.base.whole_file import write_whole
from zoo.driving.drive_log import read_drive
from zoo.driving.drive_record import PERSON, POLICY, Drive
from zoo.extras.corrections.correct_options import CorrectOptions
from zoo.simulator.recorder import split_pedals

LABELS, LABELS_IMAGE = "labels.csv", "labels.png"
COLUMNS = ("override", "image", "seconds_before", "sent", "steering")
TEXT = cv2.FONT_HERSHEY_SIMPLEX
WIDTH = 320  # of a frame in the image of the labels
LABEL_EVERY_S = 0.5  # the steering is interpolated between labels


@dataclass(frozen=True)
class Override:
    """A takeover: its number and time, and the network's rows just before it, int64 [N]."""

    number: int
    began_s: float
    rows: np.ndarray


def check_person(options: CorrectOptions) -> None:
    """Check the person's corrections before anything is written or driven.

    Raises:
        InputError: no such recording or drive, or a drive without images or takeovers.
    """
    if options.recording is not None:
        read_recordings(options.recording)
    if options.drive is None:
        return
    takeovers = overrides(read_drive(options.drive), options.before_s)
    if not takeovers:
        raise InputError(f"{options.drive}: has no takeover to correct; name another drive")
    if not any(len(takeover.rows) for takeover in takeovers):
        raise InputError(f"{options.drive}: has no images; drive again with record=FOLDER")


def ask_person(options: CorrectOptions, folder: Path) -> None:
    """Write the file of labels for the person to fill in, or check the filled one.

    Raises:
        InputError: the file was written and must be filled in, or a label is invalid.
    """
    if options.drive is None:
        return
    if not (folder / LABELS).is_file():
        drive = read_drive(options.drive)
        _write_labels(drive, overrides(drive, options.before_s), folder)
        raise InputError(
            f"{folder / LABELS}: write the correct steering, -1..1, in the last column "
            f"({LABELS_IMAGE} shows the images; between two labels, steering is interpolated); "
            f"then run the same command with out={folder}"
        )
    read_labels(folder / LABELS)


def corrections_of_a_person(options: CorrectOptions, out: Path, folder: Path) -> int:
    """Write the person's corrections to `folder` as a recording; return its number of rows.

    Its images get new names: other recordings of the same simulator can have the same names.

    Raises:
        InputError: an image cannot be read.
    """
    rows, lines, ends = _corrected(options, out), [], set()
    with whole_folder(folder) as whole:
        (whole / IMAGE_FOLDER).mkdir()
        if options.recording is not None:
            recording = read_recordings(options.recording)
            write_car(whole, recording)
            ends = set((np.flatnonzero(missing_rows(recording)) + 1).tolist())
        elif source := read_source([str(options.drive)]):
            write_rig_of(whole, find_rig(Path(str(options.drive))), source)
        stems = image_stems(np.array([time_s for time_s, *_ in rows]))
        for number, ((_, images, numbers), stem) in enumerate(zip(rows, stems, strict=True), 1):
            targets = [whole / IMAGE_FOLDER / f"{camera}_person_{stem}" for camera in CAMERAS]
            names = [
                put_image(image, target, f"row {number}") if image else ""
                for image, target in zip(images, targets, strict=True)
            ]
            lines += [(names, numbers), *[None] * (number in ends)]
        write_log(whole, lines)
    return len(rows)


def check_unchanged(options: CorrectOptions, out: Path, folder: Path) -> None:
    """Check that a recording of corrections, if it exists, has what the person says now.

    Raises:
        InputError: labels or recording have changed.
    """
    log, rows = folder / LOG_NAME, _corrected(options, out)
    if log.is_file() and [row[2][0] for row in rows] != [row.numbers[0] for row in read_log(log)]:
        raise InputError(
            f"{options.recording or out / LABELS}: has changed since {folder} was written; correct "
            "with it in another folder: out=NEW"
        )


def overrides(drive: Drive, before_s: float) -> list[Override]:
    """Return each takeover of a drive, with the rows with an image up to `before_s` before it."""
    takeovers, previous = [], 0
    begins = np.flatnonzero(drive.intervention & (drive.driver == PERSON)).tolist()
    for number, began in enumerate(begins, 1):
        since_s = drive.time_s[began] - drive.time_s
        mine = (drive.client == drive.client[began]) & (drive.driver == POLICY)
        near = mine & (drive.frame != "") & (since_s >= 0) & (since_s <= before_s)
        near[:previous] = False  # rows before the previous takeover belong to that one
        rows, previous = np.flatnonzero(near), began
        # The original simulator sends frames twice.
        _, first = np.unique(drive.frame[rows], return_index=True)
        takeovers.append(Override(number, drive.time_s[began], rows[np.sort(first)]))
    return takeovers


def read_labels(path: Path) -> dict[str, float]:
    """Return the filled-in steering by image.

    Raises:
        InputError: no label is filled in, or one is no number in -1..1.
    """
    labels, bad = {}, BadRows()
    for line, fields in read_fields(path, bad):
        # A decimal comma divides the last column.
        text = ",".join(fields[len(COLUMNS) - 1 :]).rstrip(",")
        if text in ("", COLUMNS[-1]):
            continue
        try:
            value = float(text.replace(",", "."))
        except ValueError:
            value = np.nan
        if not -1 <= value <= 1 or not fields[1]:
            bad.faults.append(f"{path}, row {line}: {fields[1]!r:.80} has steering {text!r:.80}")
        labels[fields[1]] = value
    if bad.faults:
        raise InputError(f"{bad.faults[0]}; write a number in -1..1 in the last column")
    if not labels:
        raise InputError(f"{path}: the steering column is empty; write numbers in -1..1 there")
    return labels


def _write_labels(drive: Drive, takeovers: list[Override], folder: Path) -> None:
    """Write the labels to fill in, and an image that shows their frames."""
    lines, frames = [], []
    for takeover in takeovers:
        for row in _sparse(drive, takeover.rows):
            before_s, sent = takeover.began_s - drive.time_s[row], drive.steering[row]
            lines.append([takeover.number, drive.frame[row], f"{before_s:.2f}", f"{sent:.3f}", ""])
            path = drive.folder / drive.frame[row]
            try:
                image = read_image(path)
            except (OSError, ValueError) as error:
                raise InputError(f"{path}: {error}; name another drive") from None
            frame = cv2.resize(image, (WIDTH, WIDTH * len(image) // image.shape[1]))
            text = f"override {takeover.number}, {before_s:.1f} s before, sent {sent:+.2f}"
            frames.append(cv2.putText(frame, text, (4, 12), TEXT, 0.4, (255, 255, 255)))
    sheet = cv2.imencode(Path(LABELS_IMAGE).suffix, np.vstack(frames)[..., ::-1])[1]
    write_whole(folder / LABELS_IMAGE, sheet.tobytes())
    write_whole(folder / LABELS, csv_text([COLUMNS, *lines]))


def _sparse(drive: Drive, rows: np.ndarray) -> list[int]:
    """Return the last row, and one for every half second before it."""
    chosen = rows[-1:].tolist()
    for row in rows[::-1]:
        if drive.time_s[chosen[-1]] - drive.time_s[row] >= LABEL_EVERY_S - 0.01:
            chosen.append(int(row))
    return chosen[::-1]


def _corrected(options: CorrectOptions, out: Path) -> list[tuple]:
    """Return the time, images and numbers of each correction of the person."""
    if options.recording is not None:
        return _recorded(options.recording)
    return _labelled(str(options.drive), options.before_s, out)


def _labelled(folder: str, before_s: float, out: Path) -> list[tuple]:
    """Return the rows between each takeover's first and last label, with steering."""
    drive, labels = read_drive(folder), read_labels(out / LABELS)
    rows, unknown = [], set(labels)
    for override in overrides(drive, before_s):
        unknown -= set(drive.frame[override.rows])
        filled = [row for row in override.rows if drive.frame[row] in labels]
        if not filled:
            continue
        values = [labels[drive.frame[row]] for row in filled]
        for row in override.rows[(override.rows >= filled[0]) & (override.rows <= filled[-1])]:
            steering = float(np.interp(drive.time_s[row], drive.time_s[filled], values))
            pedals = split_pedals(drive.throttle[row])
            image = str(drive.folder / drive.frame[row])
            numbers = steering, *pedals, drive.speed_mph[row]
            rows.append((drive.time_s[row], (image, None, None), numbers))
    if unknown:
        raise InputError(f"{out / LABELS}: {min(unknown)!r:.80} is of no takeover; correct it")
    return rows


def _recorded(folder: str) -> list[tuple]:
    """Return the time, images and numbers of each row of a recording."""
    recording = read_recordings(folder)
    times_s = complete_times(recording).tolist()
    columns = (recording.steering, recording.throttle, recording.brake, recording.speed_mph)
    return list(zip(times_s, recording.images.tolist(), np.stack(columns, 1).tolist(), strict=True))
