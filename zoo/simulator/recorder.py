"""A recorder in the original simulator's format: `driving_log.csv` and `IMG/`."""

import datetime
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np

from zoo.base.errors import InputError
from zoo.base.new_folder import written_folder
from zoo.base.whole_file import AppendedFile, write_new
from zoo.simulator.udacity_car import CAMERAS

LOG_NAME, IMAGE_FOLDER = "driving_log.csv", "IMG"
COLUMNS = (*CAMERAS, "steering", "throttle", "brake", "speed")
# The quantisation tables of the original's images are those of quality 75.
JPEG_QUALITY = 75
# File names contain a time; a fixed one makes the same drive give the same recording.
FIRST_MOMENT = datetime.datetime(2020, 1, 1, 12, 0, 0)
PAUSE_S = 10.0  # between two passes; readers treat more than a second as a gap


class Recorder:
    """A recording that is being written; a context manager.

    Each row is written at once, as a whole, and after its images. Therefore the log stays readable
    when the process is killed. A recording without rows leaves no log.

    Args:
        folder: folder to create or fill; it must not contain a recording.
        header: whether the log begins with column names, as the course's sample data does.
        relative: whether paths are `IMG/center_….jpg`, with a blank before the second and third,
            as in the sample data; otherwise they are absolute, as the original's.

    Raises:
        InputError: the folder contains a recording, is a file, or cannot be written.
    """

    def __init__(self, folder: Path | str, header: bool = False, relative: bool = False) -> None:
        self.folder, self.relative = Path(folder).expanduser().absolute(), relative
        self.log = self.folder / LOG_NAME
        self.images = self.folder / IMAGE_FOLDER
        self.rows, self._held = 0, ExitStack()
        self._pass_begin_s, self._last_s = 0.0, -np.inf
        try:
            if self.log.exists():
                raise InputError(
                    f"{self.folder}: has a {LOG_NAME} already; give another folder with out=, or "
                    "delete it"
                )
            self._held.enter_context(written_folder(self.folder))
            self.images.mkdir(parents=True, exist_ok=True)
            self._file = AppendedFile(self.log)
            if header:
                self._file.append([COLUMNS])
        except OSError as error:
            self._held.close()
            raise InputError(f"{self.folder}: cannot record there: {error.strerror}") from None

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()
        with self._held:
            if not self.rows:
                self.log.unlink()
                if not any(self.images.iterdir()):
                    self.images.rmdir()

    def begin_pass(self, time: float = 0.0) -> None:
        """Restart at `time` for the next rows, `PAUSE_S` after the last row."""
        self._pass_begin_s = (self._last_s + PAUSE_S if self.rows else 0.0) - time

    def add(
        self,
        frames: dict[str, np.ndarray] | dict[str, bytes],
        steering: float,
        throttle: float,
        brake: float,
        speed_mph: float,
        time: float,
    ) -> None:
        """Write a row.

        Args:
            frames: frame of each camera, uint8 [H, W, 3], RGB, or its image of `encode`; the
                columns of absent cameras stay empty.
            steering: -1..1, right positive.
            throttle: 0..1.
            brake: 0..1.
            speed_mph: speed in mph.
            time: simulated seconds, later than the last row's; the first pass begins at 0.

        Raises:
            InputError: the disk is full, or the folder was deleted.
        """
        seconds = round(self._pass_begin_s + time, 3)
        if seconds <= self._last_s:
            raise ValueError(f"time={time}: not after the last row; call begin_pass() first")
        moment = FIRST_MOMENT + datetime.timedelta(seconds=seconds)
        paths = {camera: self.images / image_name(camera, moment) for camera in frames}
        written: list[Path] = []
        try:
            for camera, path in paths.items():
                frame = frames[camera]
                write_new(path, frame if isinstance(frame, bytes) else encode(frame))
                written.append(path)
            numbers = map(number_text, (steering, throttle, brake, speed_mph))
            names = [self._name(camera, paths.get(camera)) for camera in CAMERAS]
            self._file.append([[*names, *numbers]])
        except OSError as error:
            for path in written:
                path.unlink(missing_ok=True)
            raise InputError(
                f"{self.folder}: {error.strerror} after {self.rows} rows, which are kept; "
                "free some space, or give another folder with out="
            ) from None
        self.rows, self._last_s = self.rows + 1, seconds

    def _name(self, camera: str, path: Path | None) -> str:
        if path is None or not self.relative:
            return str(path or "")
        blank = "" if camera == CAMERAS[0] else " "
        return f"{blank}{IMAGE_FOLDER}/{path.name}"


def image_name(camera: str, moment: datetime.datetime) -> str:
    """Return the name of an image's file, with the time as the original writes it.

    >>> image_name("left", datetime.datetime(2020, 1, 1, 12, 0, 9, 66_000))
    'left_2020_01_01_12_00_09_066.jpg'
    """
    return f"{camera}_{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}.jpg"


def number_text(value: float) -> str:
    """Format a number as C# writes a float: seven digits, no trailing zeros.

    >>> number_text(0.64978641), number_text(-0.0), number_text(0.0001), number_text(-0.00001234)
    ('0.6497864', '0', '0.0001', '-1.234E-05')
    """
    return f"{value + 0.0:.7g}".upper()


def split_pedals(throttle: float) -> tuple[float, float]:
    """Split a throttle command, -1..1, into throttle and brake, 0..1 each."""
    return max(throttle, 0.0), max(-throttle, 0.0)


def encode(frame: np.ndarray) -> bytes:
    """Encode a frame, uint8 [H, W, 3] RGB, as JPEG."""
    bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
