"""The format of Udacity's simulator: a `driving_log.csv` and an `IMG` folder, from any machine."""

import difflib
import functools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS, BadRows, LogRow, read_log
from datamodules.read_options import ReadOptions
from datamodules.recording import LABELS, LOG_NAME, Recording, file_name, list_files, make_recording
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY

title = "recording"
SUGGESTED = 3  # folders with a log that the error about a folder without one names

_TIME = re.compile(r"(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d{3})(?=\.\w+$)")


def detect(path: Path) -> bool:
    """Return whether a folder holds a log, or is one."""
    return (path / LOG_NAME).exists() or (path.name == LOG_NAME and path.is_file())


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the rows of a log, with the images wherever the folder was moved to.

    Raises:
        InputError: the folder, the log, a row or an image is missing or wrong.
    """
    log = path if path.suffix == ".csv" else path / LOG_NAME
    if not log.exists():
        raise InputError(missing(path))
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
    columns = np.array([row.numbers for row in rows]).T
    numbers = dict(zip(LABELS, columns, strict=True))
    numbers["time_s"] = times_from_names([row.paths[0] for row in rows])
    lines = np.array([row.line for row in rows])
    recording = make_recording(
        log.parent, numbers, images, line=lines, bad_rows=tuple(bad_rows.faults), rig=UDACITY
    )
    good = np.ones(len(rows), dtype=bool)
    good[list(bad)] = False
    return recording.keep(good, tuple(bad[index] for index in sorted(bad)))


def missing(root: Path) -> str:
    """Return what a path lacks, and what to name: recordings in it or around it, or a near name."""
    found = [path.parent for path in sorted(root.glob(f"*/{LOG_NAME}"))]
    if not root.exists():
        near = {path.parent.name: path.parent for path in root.parent.glob(f"*/{LOG_NAME}")}
        found = [near[name] for name in difflib.get_close_matches(root.name, list(near), n=1)]
    elif not found and (root.parent / LOG_NAME).is_file():  # its IMG folder was named
        found = [root.parent]
    what = f"holds no {LOG_NAME}, and is of no other format" if root.exists() else "no such folder"
    named = ", or ".join(map(str, found[:SUGGESTED])) or f"the folder of a {LOG_NAME}"
    return f"{root}: {what}; name {named}"


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


def image_finder(root: Path, images: Path | None) -> Callable[[str], str | None]:
    """Return a function from an image, as a log names it, to its path here, or None.

    A path may be of Windows, macOS or Linux, absolute or relative. Each folder is listed once.

    Args:
        root: folder of the log, which may be from another machine.
        images: folder of the images, if not the usual one.
    """
    if images and not images.is_dir():
        raise InputError(f"{images}: no such folder; set data.images=FOLDER of the images")
    files = functools.cache(list_files)

    @functools.cache
    def folders(written: str) -> list[str]:
        """Return folders to search, best first: the given one, or IMG, the path's tails, others."""
        if images:
            return [str(images)]
        parts = [part for part in re.split(r"[\\/]", written) if part not in ("", ".")]
        tails = [root.joinpath(*parts[start:]) for start in range(len(parts))]
        img = [path for path in root.iterdir() if path.name.lower() == "img"]
        # Not \\SERVER\SHARE: Windows would log in on a stranger's server.
        is_own = re.match(r"([A-Za-z]:)?[\\/](?![\\/])", written) and Path(written).is_absolute()
        found = [*img, *tails, root, *([Path(written)] if is_own else [])]
        return [str(folder) for folder in found]

    def find(written: str) -> str | None:
        if not (name := file_name(written)):
            return None
        found = (files(folder).get(name) for folder in folders(written[: -len(name)]))
        return next(filter(None, found), None)

    return find


def times_from_names(names: list[str]) -> np.ndarray:
    """Return seconds since 1970, float64 [N], from `..._2018_07_16_17_11_43_382.jpg`; else NaN."""
    stamps = [
        "{}-{}-{}T{}:{}:{}.{}".format(*found.groups()) if (found := _TIME.search(name)) else "NaT"
        for name in names
    ]
    try:
        times = np.array(stamps, dtype="datetime64[ms]")
    except ValueError:  # such as month 13
        return np.full(len(names), np.nan)
    return np.where(np.isnat(times), np.nan, times.astype("int64") / 1000.0)
