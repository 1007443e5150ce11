"""Recordings: folders with a `driving_log.csv` and an `IMG` folder, from any machine."""

import difflib
import hashlib
import os
import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datamodules.bad_rows import BadRows
from datamodules.driving_log import CAMERAS, LogColumns, read_log_columns
from datamodules.source_format import LOG_NAME, NAMES, known_format
from zoo.base.errors import InputError

SUGGESTED = 3  # folders with a log that the error about a folder without one names
GAP_S = 1.0  # a longer time between two rows is a gap in the recording

_TIME = re.compile(r"(\d{4})_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d\d)_(\d{3})(?=\.\w+$)")


@dataclass(frozen=True)
class Recording:
    """One or several recordings as columns: a row per frame, in the order of driving.

    Attributes:
        names: recordings' folders, as the user named them.
        recording: index in `names`, int64 [N].
        line: line in the log, int64 [N].
        images: paths on this machine of center, left, right, object [N, 3]; None without an image.
        steering, throttle, brake: recorded values, float64 [N], -1..1, -1..1, 0..1.
        speed_mph: recorded speed, float64 [N].
        time_s: seconds since 1970 from the file name, float64 [N]; NaN without a time.
        bad_images: a line on each row that `on_bad_image=skip` left out.
        bad_rows: a line on each row that `on_bad_row=skip` left out.
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
    bad_rows: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.steering)

    @property
    def without_speed(self) -> list[str]:
        """Return the names of the recordings whose speed is 0 in each row."""
        moving = set(self.recording[self.speed_mph != 0].tolist())
        return [name for number, name in enumerate(self.names) if number not in moving]

    def keep(self, mask: np.ndarray, bad_images: tuple[str, ...] = ()) -> "Recording":
        """Return the rows of `mask` (bool [N]); add `bad_images` to the skipped ones."""
        columns = ("recording", "line", "images", "steering", "throttle", "brake")
        kept = {name: getattr(self, name)[mask] for name in (*columns, "speed_mph", "time_s")}
        bad_images = self.bad_images + bad_images
        return Recording(names=self.names, bad_images=bad_images, bad_rows=self.bad_rows, **kept)

    def place(self, row: int) -> str:
        """Return a row's place, for messages: `FOLDER/driving_log.csv, row 7`."""
        log = Path(self.names[self.recording[row]]) / LOG_NAME
        return f"{log}, row {self.line[row]}"

    def fingerprint(self) -> str:
        """Return 16 hex digits of labels and image names, the same wherever the folder is."""
        digest = hashlib.sha256()
        for name in ("steering", "throttle", "brake", "speed_mph", "recording"):
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        names = (os.path.basename(path) if path else "" for path in self.images.flat)  # noqa: PTH119
        digest.update("\n".join(names).encode())
        return digest.hexdigest()[:16]


def read_recordings(
    roots: str | list[str],
    images: str | None = None,
    on_bad_image: str = "fail",
    on_bad_row: str = "fail",
) -> Recording:
    """Read one folder, or several as one `Recording`.

    Args:
        roots: folders of a `driving_log.csv` each, or paths of such files.
        images: folder of the images, if not `IMG` next to the log.
        on_bad_image: `fail`, or `skip` a row whose image is missing.
        on_bad_row: `fail`, or `skip` a row that cannot be read.

    Raises:
        InputError: a folder, log, row or image is missing or wrong.
    """
    roots = [roots] if isinstance(roots, str) else list(roots)
    if not roots:
        raise InputError("data.root is an empty list: name a folder with a driving_log.csv")
    parts = [
        _read_one(number, Path(root).expanduser(), images, on_bad_image, BadRows(on_bad_row))
        for number, root in enumerate(roots)
    ]
    columns = [name for name in vars(parts[0]) if name not in ("names", "bad_images", "bad_rows")]
    whole = Recording(
        names=tuple(part.names[0] for part in parts),
        bad_images=tuple(line for part in parts for line in part.bad_images),
        bad_rows=tuple(line for part in parts for line in part.bad_rows),
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in columns},
    )
    if not len(whole):
        raise InputError(
            f"{', '.join(whole.names)}: no rows left, all {len(whole.bad_images)} have a bad image "
            f"({whole.bad_images[0]}); copy the images, or set data.images=FOLDER"
        )
    return whole


def _read_one(
    number: int, root: Path, images: str | None, on_bad_image: str, bad_rows: BadRows
) -> Recording:
    try:
        return _read_log(number, root, images, on_bad_image, bad_rows)
    except OSError as error:
        raise InputError(
            f"{error.filename or root}: {error.strerror}; allow your user to read it, or name "
            "another folder"
        ) from None


def _read_log(
    number: int, root: Path, images: str | None, on_bad_image: str, bad_rows: BadRows
) -> Recording:
    log = root if root.suffix == ".csv" else root / LOG_NAME
    if not root.exists():
        raise InputError(f"{root}: no such folder; {_suggest_near(root)}")
    if not log.exists():
        raise InputError(f"{root}: holds no {LOG_NAME}; {_suggest(root)}")
    finder = ImageFinder(log, images)
    rows = read_log_columns(log, bad_rows)
    paths = np.empty((len(rows), len(CAMERAS)), dtype=object)
    missing = []
    for camera, written in enumerate(rows.paths):
        found = finder.find_all(written)
        paths[:, camera] = found
        pairs = enumerate(zip(written, found, strict=True))
        missing.append([index for index, (name, path) in pairs if name and path is None])
    # A recording without any image of a side camera is a centre-only recording.
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
        bad_rows=tuple(bad_rows.faults),
    )
    good = np.ones(len(rows), dtype=bool)
    good[list(bad)] = False
    return recording.keep(good, tuple(bad.values()))


def _suggest(root: Path) -> str:
    """Return what to name instead of a folder without a log: the nearest folders with one."""
    if other := known_format(root):
        return f"it is a {NAMES[other]}: {shlex.join(['drivezoo', 'convert', str(root)])}"
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


def file_name(written: str) -> str:
    r"""Return the last part of a path of any system.

    >>> file_name(r"C:\Users\me\IMG\center_1.jpg"), file_name(" IMG/left_1.jpg")
    ('center_1.jpg', 'left_1.jpg')
    """
    return written[max(written.rfind("/"), written.rfind("\\")) + 1 :].strip()


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
