"""The format of Udacity's simulator: a `driving_log.csv` and an `IMG` folder, from any machine."""

import difflib
import os
import re
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS, BadRows, LogColumns, read_log_columns
from datamodules.recording import LOG_NAME, ReadOptions, Recording, file_name, make_recording
from zoo.base.errors import InputError

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
    if not path.exists():
        raise InputError(f"{path}: no such folder; {_suggest_near(path)}")
    if not log.exists():
        raise InputError(f"{path}: holds no {LOG_NAME}; {_suggest(path)}")
    finder, bad_rows = ImageFinder(log, options.images), BadRows(options.on_bad_row)
    rows = read_log_columns(log, bad_rows)
    paths, missing = {}, []
    for camera, written in zip(CAMERAS, rows.paths, strict=True):
        paths[camera] = finder.find_all(written)
        pairs = enumerate(zip(written, paths[camera], strict=True))
        missing.append([index for index, (name, path) in pairs if name and path is None])
    # A recording without any image of a side camera is a centre-only recording.
    for side in (1, 2):
        if len(missing[side]) == len(rows):
            missing[side] = []
    bad = _refuse_or_note(log, rows, missing, finder, options.on_bad_image)
    names = ("steering", "throttle", "brake", "speed_mph")
    numbers = dict(zip(names, rows.numbers.T, strict=True))
    numbers["time_s"] = times_from_names(rows.paths[0])
    recording = make_recording(
        log.parent, numbers, paths, line=rows.line, bad_rows=tuple(bad_rows.faults)
    )
    good = np.ones(len(rows), dtype=bool)
    good[list(bad)] = False
    return recording.keep(good, tuple(bad.values()))


def _suggest(root: Path) -> str:
    """Return what to name instead of a folder without a log: the nearest folders with one."""
    found = [str(path.parent) for path in sorted(root.glob(f"*/{LOG_NAME}"))]
    if not found and (root.parent / LOG_NAME).is_file():  # its IMG folder was named
        found = [str(root.parent)]
    if not found:
        return f"name the folder of a {LOG_NAME}"
    named, more = ", ".join(found[:SUGGESTED]), len(found) - SUGGESTED
    return f"name {'one of ' * (len(found) > 1)}{named}" + (f" ({more} more)" if more > 0 else "")


def _suggest_near(root: Path) -> str:
    """Return what to name instead of a missing folder: a recording there with a near name."""
    found = {path.parent.name: path.parent for path in root.parent.glob(f"*/{LOG_NAME}")}
    near = difflib.get_close_matches(root.name, list(found), n=1)
    return f"did you mean {found[near[0]]}?" if near else f"name the folder of a {LOG_NAME}"


def _refuse_or_note(
    log: Path,
    rows: LogColumns,
    missing: list[list[int]],
    finder: "ImageFinder",
    on_bad_image: str,
) -> dict[int, str]:
    """Return a line for each row with a missing image; raise InputError for `fail`."""
    bad = {}
    for camera, indices in enumerate(missing):
        for index in indices:
            written = rows.paths[camera][index]
            bad[index] = f"{log}, row {rows.line[index]}: no image {file_name(written):.200}"
    no_center = [index for index, path in enumerate(rows.paths[0]) if not path]
    bad |= {index: f"{log}, row {rows.line[index]}: names no centre image" for index in no_center}
    if bad and on_bad_image == "fail":
        raise InputError(
            f"{bad[min(bad)]} in {finder.searched()} ({len(bad)} of {len(rows)} rows lack one); "
            "copy the IMG folder there, set data.images=FOLDER, or data.on_bad_image=skip"
        )
    return dict(sorted(bad.items()))


class ImageFinder:
    """A finder on this machine of images that a log from another machine names.

    A path may be of Windows, macOS or Linux, absolute or relative. Each folder is listed once.
    """

    def __init__(self, log: Path, images: str | None) -> None:
        self.root = log.parent
        self.images = Path(images).expanduser() if images else None
        if self.images and not self.images.is_dir():
            raise InputError(f"{self.images}: no such folder; set data.images=FOLDER of the images")
        self._listings: dict[Path, dict[str, str]] = {}
        self._candidates: dict[str, list[Path]] = {}

    def find(self, written: str) -> str | None:
        """Return the image's path on this machine, or None."""
        name = file_name(written)
        if not name:
            return None
        folder = written[: len(written) - len(name)]
        if folder not in self._candidates:
            self._candidates[folder] = self._folders(folder)
        for candidate in self._candidates[folder]:
            found = self._listing(candidate).get(name)
            if found:
                return found
        return None

    def find_all(self, written: list[str]) -> list[str | None]:
        """Return each image's path or None, as `find`, but fast for a log that names one folder."""
        first = next(filter(None, written), "")
        folder = first[: len(first) - len(file_name(first))]
        self.find(first)
        table: dict[str, str] = {}
        for candidate in reversed(self._candidates.get(folder, [])):
            table |= self._listing(candidate)
        start = len(folder)
        return [
            (path.startswith(folder) and table.get(path[start:])) or self.find(path)
            for path in written
        ]

    def searched(self) -> str:
        """Return the first folder searched, for messages."""
        return str(self.images or self.root / "IMG")

    def _folders(self, written: str) -> list[Path]:
        """Return folders to search, best first: the given one, or IMG, the path's tails, others."""
        if self.images:
            return [self.images]
        parts = [part for part in re.split(r"[\\/]", written) if part not in ("", ".")]
        tails = [self.root.joinpath(*parts[start:]) for start in range(len(parts))]
        img = [path for path in self.root.iterdir() if path.name.lower() == "img"]
        # Not \\SERVER\SHARE: Windows would log in on a stranger's server.
        is_own = re.match(r"([A-Za-z]:)?[\\/](?![\\/])", written) and Path(written).is_absolute()
        return [*img, *tails, self.root, *([Path(written)] if is_own else [])]

    def _listing(self, folder: Path) -> dict[str, str]:
        if folder not in self._listings:
            try:
                # Regular files only: opening a pipe would wait for its writer.
                with os.scandir(folder) as entries:
                    files = (entry for entry in entries if entry.is_file())
                    self._listings[folder] = {entry.name: entry.path for entry in files}
            except OSError:
                self._listings[folder] = {}
        return self._listings[folder]


def times_from_names(names: list[str]) -> np.ndarray:
    """Return seconds since 1970, float64 [N], from `..._2018_07_16_17_11_43_382.jpg`; else NaN."""
    times = _plain_times(names)
    if times is None:
        stamps = [
            "{}-{}-{}T{}:{}:{}.{}".format(*found.groups())
            if (found := _TIME.search(one))
            else "NaT"
            for one in names
        ]
        try:
            times = np.array(stamps, dtype="datetime64[ms]")
        except ValueError:  # such as month 13
            return np.full(len(names), np.nan)
    seconds = times.astype("int64") / 1000.0
    return np.where(np.isnat(times), np.nan, seconds)


def _plain_times(names: list[str]) -> np.ndarray | None:
    """Return times, datetime64[ms] [N]; None unless all names end in one and three letters."""
    try:
        tails = np.array([name[-27:] for name in names], "S27")
    except UnicodeEncodeError:
        return None
    letters = tails.view(np.uint8).reshape(-1, 27)[:, :24].copy()
    between, digits = [4, 7, 10, 13, 16, 19, 23], letters - ord("0")
    digits[:, between] = 0
    if not len(names) or (digits > 9).any() or (letters[:, between] != list(b"______.")).any():
        return None
    letters[:, between] = list(b"--T::.Z")
    try:
        return letters[:, :23].copy().view("S23").ravel().astype("datetime64[ms]")
    except ValueError:
        return None
