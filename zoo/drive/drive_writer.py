"""Writes a drive while it goes on, in a thread of its own, so that no disk ever delays a reply."""

import contextlib
import datetime
import queue
import tempfile
import threading
from dataclasses import replace
from pathlib import Path

from datamodules.errors import InputError
from zoo.drive.notices import Notices
from zoo.drives.drive_log import (
    LOG_NAME,
    AppendedFile,
    DriveWriter,
    read_drive,
    write_summary,
)
from zoo.drives.drive_record import SOCKET, DriveRow
from zoo.drives.metrics import measure

RECORDING_LOG, IMAGE_FOLDER = "driving_log.csv", "IMG"
MEASURED_BYTES = 10_000_000  # of a log, three hours; a longer one is measured by its readers
WAITING = 512  # rows, with their pictures 8 MB; a disk that is slower than that loses some


class Scribe:
    """Takes rows and pictures at once and writes them when it can.

    Args:
        folder: of the drive; made with the first row.
        notices: told of a full disk, and of rows that were dropped because it is too slow.

    Attributes:
        recorded: rows in the folder's `driving_log.csv`.

    Raises:
        InputError: the folder holds a drive or a recording already.
    """

    def __init__(self, folder: Path, notices: Notices) -> None:
        for name in ("drive.csv", RECORDING_LOG):
            if (folder / name).exists():
                raise InputError(
                    f"{folder} holds a {name} already; name another folder with drive.record="
                )
        self.folder, self.notices = folder.absolute(), notices
        self.recorded = 0
        self._queue: queue.Queue[tuple[DriveRow, bytes | None] | None] = queue.Queue(WAITING)
        self._writer: DriveWriter | None = None
        self._recording: AppendedFile | None = None
        self._last_picture, self._last_frame = b"", ""
        self._last_moment = datetime.datetime.min
        # A daemon: a disk that hangs must not keep the process from ending.
        self._thread = threading.Thread(target=self._write_all, name="scribe", daemon=True)
        self._thread.start()

    def prepare(self) -> None:
        """Make the folder now, so that one that cannot be written to is known before the drive.

        Raises:
            InputError: that it is.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                pass
        except OSError as error:
            raise InputError(
                f"drive.record={self.folder}: {error.strerror}; name another folder"
            ) from None

    def put(self, row: DriveRow, picture: bytes | None) -> None:
        """Have a row written, and its picture (JPEG or PNG as it came) if there is one."""
        try:
            self._queue.put_nowait((row, picture))
        except queue.Full:
            self.notices.say("the disk is too slow, rows of the drive were not written")

    def close(self, summary: dict, timeout_s: float = 10.0) -> bool:
        """Write what is waiting, and the summary; False if there was nothing to write, or no way.

        `summary` gets `recorded_rows`, and the metrics of the rows beside its own keys.
        """
        self._queue.put(None)
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self.notices.say("the disk does not answer, the end of the drive is not written")
            return False
        if self._writer is None:
            with contextlib.suppress(OSError):  # it was not made, or is not empty
                self.folder.rmdir()
            return False
        summary = {"drive": SOCKET, **summary, "recorded_rows": self.recorded}
        try:
            write_summary(self.folder, summary)  # first: measuring takes a while
            if (self.folder / LOG_NAME).stat().st_size <= MEASURED_BYTES:
                write_summary(self.folder, measure(read_drive(self.folder)) | summary)
        except (OSError, InputError) as error:
            self._failed(error)
        return True

    def _write_all(self) -> None:
        while (item := self._queue.get()) is not None:
            items = [item]
            while not self._queue.empty() and items[-1] is not None and len(items) < WAITING:
                items.append(self._queue.get())
            rows = [self._record(*one) for one in items if one is not None]
            try:
                if self._writer is None:
                    self._writer = DriveWriter(self.folder)
                self._writer.add(rows)
            except (OSError, InputError) as error:
                self._failed(error)
            if items[-1] is None:
                break
        for file in (self._writer, self._recording):
            if file is not None:
                file.close()

    def _record(self, row: DriveRow, picture: bytes | None) -> DriveRow:
        """Write the picture and its line; the row, with the picture's place filled in."""
        if picture is None:
            return row
        # The old client's two loops send most pictures twice.
        if picture == self._last_picture:
            return replace(row, frame=self._last_frame)
        path = None
        try:
            if self._recording is None:
                (self.folder / IMAGE_FOLDER).mkdir(parents=True, exist_ok=True)
                self._recording = AppendedFile(self.folder / RECORDING_LOG)
            path = self.folder / IMAGE_FOLDER / f"center_{self._stamp()}.jpg"
            path.write_bytes(picture)
            brake = max(-row.throttle, 0.0)
            numbers = (row.steering, max(row.throttle, 0.0), brake, row.speed_mph)
            # There is one camera: the columns of the left and the right one stay empty.
            self._recording.append([[path, "", "", *map(number_text, numbers)]])
        except OSError as error:
            if path is not None:
                path.unlink(missing_ok=True)
            self._failed(error)
            return row
        self.recorded += 1
        self._last_picture, self._last_frame = picture, f"{IMAGE_FOLDER}/{path.name}"
        return replace(row, frame=self._last_frame)

    def _stamp(self) -> str:
        """The time as the original writes it into file names, never the same twice."""
        step = datetime.timedelta(milliseconds=1)
        self._last_moment = max(datetime.datetime.now(), self._last_moment + step)
        moment = self._last_moment
        return f"{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}"

    def _failed(self, error: Exception) -> None:
        reason = getattr(error, "strerror", None) or str(error)
        self.notices.say(f"{self.folder} cannot be written to, driving goes on", reason)


def number_text(value: float) -> str:
    """A number as C# writes a float: seven digits, and no zeros after the last."""
    return f"{value + 0.0:.7g}".upper()
