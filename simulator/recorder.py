"""Writes what was driven as the original simulator does: `driving_log.csv` and `IMG/`."""

import csv
import datetime
import io
import os
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from simulator.errors import SimulatorError
from simulator.rig import CAMERAS

LOG_NAME, IMAGE_FOLDER = "driving_log.csv", "IMG"
COLUMNS = (*CAMERAS, "steering", "throttle", "brake", "speed")
# What the original's images hold: its quantisation tables are those of quality 75.
JPEG_QUALITY = 75
# File names carry a time. A recording made twice is the same, so its clock does not tell today's.
FIRST_MOMENT = datetime.datetime(2020, 1, 1, 12, 0, 0)
PAUSE_S = 10.0  # between two passes; readers take more than a second for a gap


class Recorder:
    """A recording being written; use it in a `with`.

    A row is written at once, in whole, and after its images: whatever ends the process, the log
    can be read up to there. A recording that got no row leaves no log.

    Args:
        folder: made if need be; it must not hold a recording yet.
        header: begin the log with the columns' names, as the course's sample data does.
        relative: write `IMG/center_….jpg` and a blank before the next paths, as it does too;
            otherwise this machine's absolute paths, as the original does.

    Raises:
        SimulatorError: the folder holds a recording, is a file, cannot be written to, or is full.
    """

    def __init__(self, folder: Path | str, header: bool = False, relative: bool = False) -> None:
        self.folder, self.relative = Path(folder).expanduser().absolute(), relative
        self.log = self.folder / LOG_NAME
        self.images = self.folder / IMAGE_FOLDER
        self.rows = 0
        self._pass_begin_s, self._last_s = 0.0, -np.inf
        try:
            check_free(self.folder)
            self.images.mkdir(parents=True, exist_ok=True)
            self._file = self.log.open("xb", buffering=0)
            if header:
                self._append(",".join(COLUMNS) + "\n")
        except OSError as error:
            raise SimulatorError(f"{self.folder}: cannot record there: {error.strerror}") from None

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
        if not self.rows:
            self.log.unlink()
            if not any(self.images.iterdir()):
                self.images.rmdir()

    def begin_pass(self) -> None:
        """Let `time` begin at 0 once more, some seconds after the last row."""
        if self.rows:
            self._pass_begin_s = self._last_s + PAUSE_S

    def add(
        self,
        frames: dict[str, np.ndarray],
        steering: float,
        throttle: float,
        brake: float,
        speed_mph: float,
        time: float,
    ) -> None:
        """Write a row: uint8 [160, 320, 3] RGB by camera, steering -1..1, throttle and brake 0..1,
        and the pass's simulated time in seconds, later than the last row's.

        Raises:
            SimulatorError: the disk is full, or the folder has gone.
        """
        seconds = round(self._pass_begin_s + time, 3)
        if seconds <= self._last_s:
            raise ValueError(
                f"time={time}: the row before is no earlier; begin_pass() was not called"
            )
        moment = FIRST_MOMENT + datetime.timedelta(seconds=seconds)
        stamp = moment.strftime("%Y_%m_%d_%H_%M_%S_") + f"{moment.microsecond // 1000:03d}"
        paths = [self.images / f"{camera}_{stamp}.jpg" for camera in CAMERAS]
        try:
            for camera, path in zip(CAMERAS, paths, strict=True):
                path.write_bytes(_jpeg(frames[camera]))
            self._append(self._line(paths, (steering, throttle, brake, speed_mph)))
        except OSError as error:
            for path in paths:
                path.unlink(missing_ok=True)
            raise SimulatorError(
                f"{self.folder}: {error.strerror} after {self.rows} rows, which can be used; "
                "make room there, or name another folder with out="
            ) from None
        self.rows, self._last_s = self.rows + 1, seconds

    def _line(self, paths: list[Path], numbers: tuple[float, ...]) -> str:
        fields = [str(path) for path in paths]
        if self.relative:
            names = [f"{IMAGE_FOLDER}/{path.name}" for path in paths]
            fields = [names[0], *(f" {name}" for name in names[1:])]
        line = io.StringIO()
        # A folder with a comma in its name needs quotes, which the original forgets.
        csv.writer(line, lineterminator="\n").writerow([*fields, *map(number_text, numbers)])
        return line.getvalue()

    def _append(self, line: str) -> None:
        """Write a line whole or not at all."""
        size, text = os.fstat(self._file.fileno()).st_size, line.encode()
        try:
            written = 0
            while written < len(text):  # a disk that is nearly full takes the beginning first
                written += self._file.write(text[written:])
        except OSError:
            self._file.truncate(size)
            raise


def check_free(folder: Path | str) -> None:
    """Raise SimulatorError where a folder holds a recording; nothing is made there."""
    folder = Path(folder).expanduser().absolute()
    if (folder / LOG_NAME).exists():
        raise SimulatorError(
            f"{folder} holds a {LOG_NAME} already: name another folder with out=, or remove it"
        )


def number_text(value: float) -> str:
    """A number as C# writes a float: seven digits, and no zeros after the last.

    >>> number_text(0.64978641), number_text(1.0), number_text(-0.00001234)
    ('0.6497864', '1', '-1.234E-05')
    """
    return f"{value + 0.0:.7g}".upper()


def split_pedals(throttle: float) -> tuple[float, float]:
    """Throttle and brake, 0..1 each, of a command -1..1."""
    return max(throttle, 0.0), max(-throttle, 0.0)


def _jpeg(frame: np.ndarray) -> bytes:
    bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
