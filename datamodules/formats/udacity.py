"""The format of Udacity's simulator: a `driving_log.csv` and an `IMG` folder, from any machine."""

import functools
import os
import re
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS, IMAGE, BadRows, LogRow, read_log
from datamodules.format_options import Converted, Progress, ReadOptions, WriteOptions
from datamodules.formats.recording_writer import (
    image_stems,
    left_out_note,
    put_image,
    reported,
    whole_rows,
    write_log,
)
from datamodules.recorded_car import write_car
from datamodules.recording import (
    IMAGE_FOLDER,
    LABELS,
    LOG_NAME,
    Recording,
    file_name,
    fold,
    list_files,
    make_recording,
    spellings,
    unnamed_note,
)
from datamodules.stretches import complete_times, continuous_drives, missing_rows
from zoo.base.errors import InputError
from zoo.base.new_folder import whole_folder
from zoo.base.rig import UDACITY

title = "recording"
uses = ("images",)  # of `ReadOptions`

_TIME = re.compile(r"(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d{3})(?=\.\w+$)")


def detect(path: Path) -> bool:
    """Return whether a folder holds a log, or is one."""
    return (path / LOG_NAME).exists() or (path.name == LOG_NAME and path.is_file())


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the rows of a log, with the images wherever the folder was moved to.

    Raises:
        InputError: the folder, the log, a row or an image is missing or wrong.
    """
    log = path if path.is_file() else path / LOG_NAME
    folder = Path(options.images).expanduser() if options.images else None
    find, bad_rows = image_finder(log.parent, folder), BadRows(options.on_bad_row)
    rows = list(read_log(log, bad_rows, options.unit))
    images = {name: [find(row.paths[at]) for row in rows] for at, name in enumerate(CAMERAS)}
    bad = _missing_images(log, rows, images)
    if bad and options.on_bad_image == "fail":
        skip = ", or data.on_bad_image=skip" if len(bad) < len(rows) else ""
        raise InputError(
            f"{bad[min(bad)]} in {folder or log.parent / 'IMG'} ({len(bad)} of {len(rows)} "
            f"rows lack one); copy the IMG folder there, or set data.images=FOLDER{skip}"
        )
    numbers = dict(zip(LABELS, np.array([row.numbers for row in rows]).T, strict=True))
    numbers["time_s"] = times_from_names([row.paths[0] for row in rows])
    lines = np.array([row.line for row in rows])
    recording = make_recording(
        log.parent, numbers, images, line=lines, bad_rows=tuple(bad_rows.faults), rig=UDACITY
    )
    centre = Counter(os.path.dirname(image) for image in images["center"] if image)  # noqa: PTH120
    left_out = len(CAMERAS) * len(bad_rows.faults)
    notes = [*bad_rows.notes, *unnamed_note(centre, recording.images, left_out)]
    notes += [
        f"the images of {count:,} rows are read from {source}, where the log's paths lead"
        for source, count in centre.items()
        if not folder and not Path(source).is_relative_to(log.parent)
    ]
    good = ~np.isin(np.arange(len(rows)), list(bad))
    return replace(recording, notes=tuple(notes)).keep(good, tuple(bad[at] for at in sorted(bad)))


def write(recording: Recording, out: Path, options: WriteOptions, progress: Progress) -> Converted:
    """Write a recording's rows as a log with images.

    Image files are linked or copied as they are.

    Raises:
        InputError: an image cannot be read, `out` exists, or the disk is full.
    """
    recording, left_out = whole_rows(recording)
    recording = replace(recording, time_s=complete_times(recording))
    stems = image_stems(recording.time_s)
    written = np.full(recording.images.shape, "", object)
    with whole_folder(out) as part:
        (part / IMAGE_FOLDER).mkdir()
        for row, camera in reported(_reading_order(recording), progress):
            target = part / IMAGE_FOLDER / f"{CAMERAS[camera]}_{stems[row]}"
            image, source = recording.images[row, camera], recording.place(row)
            written[row, camera] = put_image(image, target, source, quality=options.quality)
        columns = (recording.steering, recording.throttle, recording.brake, recording.speed_mph)
        rows: list = [*zip(written.tolist(), np.stack(columns, 1).tolist(), strict=True)]
        for row in np.flatnonzero(missing_rows(recording))[::-1].tolist():
            rows.insert(row + 1, None)
        write_log(part, rows)
        write_car(part, recording, recording.format)
    notes = [
        *left_out_note(recording.bad_rows, "they cannot be read"),
        *left_out_note([*recording.bad_images, *left_out], "their image is damaged or missing"),
        *recording.notes,
    ]
    return Converted(out, len(recording), len(continuous_drives(recording)), tuple(notes))


def _reading_order(recording: Recording) -> list[tuple[int, int]]:
    """Return row and camera of each image: camera by camera, each file from its beginning."""

    def place(at: tuple[int, int]) -> tuple[int, str, int]:
        image = recording.images[at]
        return at[1], getattr(image, "file", ""), getattr(image, "number", at[0])

    rows, cameras = np.nonzero(recording.images.astype(bool))
    return sorted(zip(rows.tolist(), cameras.tolist(), strict=True), key=place)


def _missing_images(
    log: Path, rows: list[LogRow], images: dict[str, list[str | None]]
) -> dict[int, str]:
    """Return a line for each row that names no centre image, or an image that is missing."""
    bad = {}
    for camera, paths in enumerate(images.values()):
        # A recording without any image of a side camera is a centre-only recording.
        if camera and not any(paths):
            continue
        for index in [index for index, path in enumerate(paths) if path is None]:
            name = file_name(rows[index].paths[camera])
            if name or not camera:
                what = f"no image {name:.200}" if name else "names no centre image"
                bad[index] = f"{log}, row {rows[index].line}: {what}"
    return bad


def image_finder(root: Path, images: Path | None = None) -> Callable[[str], str | None]:
    """Return a function from an image, as a log names it, to its path here, or None.

    A path may be of Windows, macOS or Linux, absolute or relative. Each folder is listed once.

    Args:
        root: folder of the log, which may be from another machine.
        images: folder of the images, if not the usual one.
    """
    if images and not images.is_dir():
        raise InputError(f"{images}: no such folder; set data.images=FOLDER of the images")
    files = functools.cache(list_files)
    inner = [entry.path for entry in os.scandir(root) if entry.is_dir()]

    @functools.cache
    def folders(written: str) -> list[str]:
        """Return folders to search: the given one, or the path's tails, IMG, and the log's."""
        if images:
            return [str(images)]
        parts = [part for part in re.split(r"[\\/]", written) if part not in ("", ".", "..")]
        tails = [root.joinpath(*parts[start:]) for start in range(len(parts))]
        img = [path for path in sorted(root.iterdir()) if path.name.lower() == IMAGE_FOLDER.lower()]
        here = [str(folder) for folder in [*tails, root, *img]]
        # Not \\SERVER\SHARE: Windows would log in on a stranger's server.
        is_own = re.match(r"([A-Za-z]:)?[\\/](?![\\/])", written) and Path(written).is_absolute()
        # Of a folder whose images were copied here, those that are missing were left out.
        copied = set().union(*map(files, here)) & files(written).keys() if is_own else set()
        return [*here, written] if is_own and not any(map(IMAGE.search, copied)) else here

    spelled = functools.cache(lambda folder: spellings(files(folder)))

    def find(written: str) -> str | None:
        if not (name := file_name(written)):
            return None
        within = folders(written[: -len(name)])
        for paths, key in ((files, str), (spelled, fold)):
            candidates = (paths(folder).get(key(name)) for folder in within)
            if path := next(filter(None, candidates), None):
                return path
        # A name without a folder may be of an image in any folder, unless two have that name.
        anywhere = [] if images or name != written else inner
        others = [path for folder in anywhere if (path := spelled(folder).get(fold(name)))]
        return others[0] if len(others) == 1 else None

    return find


def times_from_names(names: list[str]) -> np.ndarray:
    """Return seconds since 1970, float64 [N], from `..._2018_07_16_17_11_43_382.jpg`; else NaN."""
    times = np.full(len(names), "NaT", dtype="datetime64[ms]")
    for row, name in enumerate(names):
        with suppress(ValueError):  # such as month 13
            if match := _TIME.search(name):
                times[row] = "{}-{}-{}T{}:{}:{}.{}".format(*match.groups())
    return np.where(np.isnat(times), np.nan, times.astype("int64") / 1000.0)
