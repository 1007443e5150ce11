"""Recordings: folders with a `driving_log.csv` and an `IMG` folder, wherever they were made."""

import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS, LogColumns, read_log_columns
from datamodules.errors import InputError

LOG_NAME = "driving_log.csv"
SUGGESTED = 3  # folders with a log that are named where the given one has none
GAP_S = 1.0  # a pause between two rows that is longer than this is a gap in the recording

_TIME = re.compile(r"(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d{3})(?=\.\w+$)")


@dataclass(frozen=True)
class Recording:
    """One or several recordings as columns, a row a frame, in the order they were driven.

    Attributes:
        names: the recordings' folders, as the user named them.
        recording: int64 [N], which of `names` a row is of.
        line: int64 [N], the row's line in its log.
        images: object [N, 3], paths on this machine of center, left, right; None without a camera.
        steering, throttle, brake: float64 [N], -1..1, 0..1, 0..1.
        speed_mph: float64 [N].
        time_s: float64 [N], seconds since 1970 from the file name; NaN where it carries none.
        bad_images: what was skipped for `on_bad_image=skip`, one line each.
    """

    names: tuple[str, ...]
    recording: np.ndarray
    line: np.ndarray
    images: np.ndarray
    steering: np.ndarray
    throttle: np.ndarray
    brake: np.ndarray
    speed_mph: np.ndarray
    time_s: np.ndarray
    bad_images: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.steering)

    def keep(self, mask: np.ndarray, bad_images: tuple[str, ...] = ()) -> "Recording":
        """Return the rows of `mask` (bool [N]); add `bad_images` to the skipped ones."""
        columns = ("recording", "line", "images", "steering", "throttle", "brake")
        kept = {name: getattr(self, name)[mask] for name in (*columns, "speed_mph", "time_s")}
        return Recording(names=self.names, bad_images=self.bad_images + bad_images, **kept)

    def place(self, row: int) -> str:
        """Return a row's place, for messages: `FOLDER/driving_log.csv, row 7`."""
        log = Path(self.names[self.recording[row]]) / LOG_NAME
        return f"{log}, row {self.line[row]}"

    def fingerprint(self) -> str:
        """16 hex digits of the rows' labels and image names: equal wherever the folder stands."""
        digest = hashlib.sha256()
        for name in ("steering", "throttle", "brake", "speed_mph", "recording"):
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        names = (os.path.basename(path) if path else "" for path in self.images.flat)  # noqa: PTH119
        digest.update("\n".join(names).encode())
        return digest.hexdigest()[:16]


def read_recordings(
    roots: str | list[str], images: str | None = None, on_bad_image: str = "fail"
) -> Recording:
    """Read one folder or several; rows of several are concatenated and keep which is which.

    Args:
        roots: folders that hold a `driving_log.csv` each (or the paths of such files).
        images: the folder with the pictures, where it is not `IMG` beside the log.
        on_bad_image: `fail` or `skip` a row whose image is missing.

    Raises:
        InputError: a folder, log, row or image is missing or wrong.
    """
    roots = [roots] if isinstance(roots, str) else list(roots)
    if not roots:
        raise InputError("data.root is an empty list: name a folder with a driving_log.csv")
    parts = [
        _read_one(number, Path(root).expanduser(), images, on_bad_image)
        for number, root in enumerate(roots)
    ]
    columns = [name for name in vars(parts[0]) if name not in ("names", "bad_images")]
    whole = Recording(
        names=tuple(part.names[0] for part in parts),
        bad_images=tuple(line for part in parts for line in part.bad_images),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns},
    )
    if not len(whole):
        raise InputError(
            f"{', '.join(whole.names)}: no rows left, all {len(whole.bad_images)} have a bad image "
            f"({whole.bad_images[0]})"
        )
    return whole


def _read_one(number: int, root: Path, images: str | None, on_bad_image: str) -> Recording:
    try:
        return _read_log(number, root, images, on_bad_image)
    except OSError as error:
        raise InputError(
            f"{error.filename or root}: {error.strerror}; allow your user to read it, or name "
            "another folder"
        ) from None


def _read_log(number: int, root: Path, images: str | None, on_bad_image: str) -> Recording:
    log = root if root.suffix == ".csv" else root / LOG_NAME
    if not root.exists():
        raise InputError(f"{root}: no such folder; set data.root to the folder of a {LOG_NAME}")
    if not log.exists():
        raise InputError(f"{root}: holds no {LOG_NAME}; {_suggest(root)}")
    finder = ImageFinder(log, images)
    rows = read_log_columns(log)
    paths = np.empty((len(rows), len(CAMERAS)), dtype=object)
    missing = []
    for camera, written in enumerate(rows.paths):
        found = finder.find_all(written)
        paths[:, camera] = found
        pairs = enumerate(zip(written, found, strict=True))
        missing.append([index for index, (name, path) in pairs if name and path is None])
    # A folder from which every picture of a side camera was left out is a centre-only recording.
    for camera in (1, 2):
        if len(missing[camera]) == len(rows):
            missing[camera] = []
    bad = _refuse_or_note(log, rows, missing, finder, on_bad_image)
    numbers = rows.numbers
    recording = Recording(
        names=(str(log.parent),),
        recording=np.full(len(rows), number),
        line=rows.line,
        images=paths,
        steering=numbers[:, 0],
        throttle=numbers[:, 1],
        brake=numbers[:, 2],
        speed_mph=numbers[:, 3],
        time_s=times_from_names(rows.paths[0]),
    )
    good = np.ones(len(rows), dtype=bool)
    good[list(bad)] = False
    return recording.keep(good, tuple(bad.values()))


def _suggest(root: Path) -> str:
    """Return what to set `data.root` to: folders one level down, where they have a log."""
    found = [str(path.parent) for path in sorted(root.glob(f"*/{LOG_NAME}"))]
    if not found:
        return "set data.root to the folder that does"
    named, more = ", ".join(found[:SUGGESTED]), len(found) - SUGGESTED
    return f"set data.root to {'one of ' * (len(found) > 1)}{named}" + (
        f" ({more} more)" if more > 0 else ""
    )


def _refuse_or_note(
    log: Path,
    rows: LogColumns,
    missing: list[list[int]],
    finder: "ImageFinder",
    on_bad_image: str,
) -> dict[int, str]:
    """Rows with a missing image, and a line on each; InputError if that is to fail."""
    bad = {}
    for camera, indices in enumerate(missing):
        for index in indices:
            written = rows.paths[camera][index]
            bad[index] = f"{log}, row {rows.line[index]}: no image {file_name(written)}"
    no_center = [index for index, path in enumerate(rows.paths[0]) if not path]
    bad |= {index: f"{log}, row {rows.line[index]}: names no centre image" for index in no_center}
    if bad and on_bad_image == "fail":
        raise InputError(
            f"{bad[min(bad)]} in {finder.searched()} ({len(bad)} of {len(rows)} rows lack one); "
            "copy the IMG folder there, set data.images=FOLDER, or data.on_bad_image=skip"
        )
    return dict(sorted(bad.items()))


class ImageFinder:
    """Finds on this machine the image that a log from another machine names.

    A path may be of Windows, macOS or Linux, absolute or relative. Folders are looked at once.
    """

    def __init__(self, log: Path, images: str | None) -> None:
        self.root = log.parent
        self.images = Path(images).expanduser() if images else None
        if self.images and not self.images.is_dir():
            raise InputError(f"{self.images}: no such folder; data.images names the pictures' one")
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
        """`find` for each; most of a log names one folder, where a look in a table is enough."""
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
        """Where to look, best first: the named folder, IMG beside the log, the path's own tail."""
        if self.images:
            return [self.images]
        parts = [part for part in re.split(r"[\\/]", written) if part not in ("", ".")]
        tails = [self.root.joinpath(*parts[start:]) for start in range(len(parts))]
        img = [path for path in self.root.iterdir() if path.name.lower() == "img"]
        as_written = [Path(written)] if written.startswith("/") else []
        return [*img, *tails, self.root, *as_written]

    def _listing(self, folder: Path) -> dict[str, str]:
        if folder not in self._listings:
            try:
                # Regular files only: to open a pipe waits for its writer.
                with os.scandir(folder) as entries:
                    files = (entry for entry in entries if entry.is_file())
                    self._listings[folder] = {entry.name: entry.path for entry in files}
            except OSError:
                self._listings[folder] = {}
        return self._listings[folder]


def file_name(written: str) -> str:
    r"""Return the last part of a path of any system.

    >>> file_name(r"C:\Users\me\IMG\center_1.jpg"), file_name(" IMG/left_1.jpg")
    ('center_1.jpg', 'left_1.jpg')
    """
    return written[max(written.rfind("/"), written.rfind("\\")) + 1 :].strip()


def times_from_names(names: list[str]) -> np.ndarray:
    """Seconds since 1970 (float64 [N]) from `..._2018_07_16_17_11_43_382.jpg`; NaN without."""
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
        except ValueError:  # a name that looks like a time and is none, such as month 13
            return np.full(len(names), np.nan)
    seconds = times.astype("int64") / 1000.0
    return np.where(np.isnat(times), np.nan, seconds)


def _plain_times(names: list[str]) -> np.ndarray | None:
    """datetime64[ms] [N] where every name ends in a time and three letters; None otherwise."""
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
