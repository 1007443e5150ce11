"""Writing of a drive in a background thread, so that the disk never delays a reply."""

import contextlib
import datetime
import queue
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from datamodules.recorded_car import write_rig_of
from zoo.base.errors import InputError, file_errors
from zoo.base.new_folder import written_folder
from zoo.base.notices import Notices
from zoo.base.rig import UDACITY, Rig
from zoo.base.whole_file import AppendedFile, write_new
from zoo.driving.drive_log import LOG_NAME, DriveWriter, read_drive, write_summary
from zoo.driving.drive_record import SOCKET, DriveRow
from zoo.driving.metrics import measure
from zoo.simulator.recorder import IMAGE_FOLDER, PAUSE_S, image_name, number_text, split_pedals
from zoo.simulator.recorder import LOG_NAME as RECORDING_LOG

MEASURED_BYTES = 10_000_000  # of a drive.csv, 3 h; readers compute the metrics of a longer one
WAITING = 512  # rows in the queue, 8 MB with images; further rows are dropped on a slow disk
LEAST_STEP_S = 0.001  # between two images, whose names tell milliseconds
Item = tuple[DriveRow, bytes | None, bool]


class BackgroundWriter:
    """Writer that queues rows and images, and writes them in a background thread.

    Args:
        folder: folder of the drive; created with the first row.
        notices: log of a full disk, and of rows dropped on a slow disk.
        source: where the frames are from, for `source.json`, if not of Udacity's car.

    Attributes:
        recorded: number of rows in the folder's `driving_log.csv`.
        rig: driven car, None if it is unknown; a simulator that tells its own sets it before the
            first row.

    Raises:
        InputError: the folder holds a drive or a recording already.
    """

    def __init__(self, folder: Path, notices: Notices, source: str | None = None) -> None:
        for name in ("drive.csv", RECORDING_LOG):
            if (folder / name).exists():
                raise InputError(
                    f"{folder}: holds a {name} already; name another folder with record="
                )
        self.folder, self.notices, self.source = folder.absolute(), notices, source
        self.recorded = 0
        self.rig: Rig | None = UDACITY if source is None else None
        self._held, self._is_open = contextlib.ExitStack(), False
        self._queue: queue.Queue[Item | None] = queue.Queue(WAITING)
        self._writer: DriveWriter | None = None
        self._recording: AppendedFile | None = None
        self._last_image, self._last_frame = b"", ""
        self._last_moment: datetime.datetime | None = None
        self._last_s = 0.0
        # A daemon, so that the process can end while the disk hangs.
        self._thread = threading.Thread(target=self._write_all, name="drive-writer", daemon=True)
        self._thread.start()

    def prepare(self) -> None:
        """Create the folder, and check before the drive that it can be written to.

        Raises:
            InputError: the folder cannot be written to.
        """
        with file_errors(f"record={self.folder}", "{}; name another folder"):
            self._open_folder()
            tempfile.TemporaryFile(dir=self.folder).close()

    def _open_folder(self) -> None:
        """Create and lock the folder, once."""
        if not self._is_open:
            self._held.enter_context(written_folder(self.folder, "record="))
            self._is_open = True

    def put(self, row: DriveRow, image: bytes | None, begins: bool = False) -> None:
        """Queue a row for writing.

        Args:
            row: row of the drive.
            image: bytes of its JPEG or PNG as the client sent them; None to record no image.
            begins: whether the recording gets a gap before the image.
        """
        try:
            self._queue.put_nowait((row, image, begins))
        except queue.Full:
            self.notices.report("rows of the drive were dropped: the disk is too slow")

    def close(self, summary: dict, timeout_s: float = 10.0) -> bool:
        """Write the queued rows and `drive.json`.

        Args:
            summary: figures for `drive.json`; `recorded_rows` and the metrics are added.
            timeout_s: longest wait for the disk, in seconds.

        Returns:
            False if there were no rows, or the disk does not answer.
        """
        until = time.monotonic() + timeout_s
        with contextlib.suppress(queue.Full):
            self._queue.put(None, timeout=timeout_s)
        self._thread.join(max(until - time.monotonic(), 0))
        if self._thread.is_alive():
            self.notices.report("the end of the drive is not written: the disk does not answer")
            return False
        with self._held:
            if self._writer is None:
                return False
            summary = {"drive": SOCKET, **summary, "recorded_rows": self.recorded}
            try:
                write_summary(self.folder, summary)  # before the metrics, which take some seconds
                if (self.folder / LOG_NAME).stat().st_size <= MEASURED_BYTES:
                    write_summary(self.folder, measure(read_drive(self.folder)) | summary)
            except (OSError, InputError) as error:
                self._failed(error)
            return True

    def _write_all(self) -> None:
        while (item := self._queue.get()) is not None:
            items: list[Item | None] = [item]
            while not self._queue.empty() and items[-1] is not None and len(items) < WAITING:
                items.append(self._queue.get())
            rows = [self._record(*item) for item in items if item is not None]
            try:
                if self._writer is None:
                    self._open_folder()
                    self._writer = DriveWriter(self.folder)
                self._writer.add(rows)
            except (OSError, InputError) as error:
                self._failed(error)
            if items[-1] is None:
                break
        for file in (self._writer, self._recording):
            if file is not None:
                file.close()

    def _record(self, row: DriveRow, image: bytes | None, begins: bool) -> DriveRow:
        """Write an image and its line of the recording; return the row with the image's path."""
        if image is None:
            return row
        # The old client's two loops send most images twice.
        if image == self._last_image:
            return replace(row, frame=self._last_frame)
        try:
            if self._recording is None:
                self._open_folder()
                (self.folder / IMAGE_FOLDER).mkdir(exist_ok=True)
                write_rig_of(self.folder, self.rig, self.source or "")
                self._recording = AppendedFile(self.folder / RECORDING_LOG)
            name = image_name("center", self._moment(row.time_s, begins))
            path = self.folder / IMAGE_FOLDER / name
            write_new(path, image)
            numbers = (row.steering, *split_pedals(row.throttle), np.nan_to_num(row.speed_mph))
            # There is one camera, so that the columns of the side cameras stay empty.
            self._recording.append([[path, "", "", *map(number_text, numbers)]])
        except (OSError, InputError) as error:
            self._failed(error)
            return row
        self.recorded += 1
        self._last_image, self._last_frame = image, f"{IMAGE_FOLDER}/{path.name}"
        return replace(row, frame=self._last_frame)

    def _moment(self, time_s: float, begins: bool) -> datetime.datetime:
        """Return the time of an image: the first is of now, others are by the drive's own clock."""
        step_s = time_s - self._last_s
        if begins or not 0 <= step_s <= PAUSE_S:  # as of another simulator, or clock
            step_s = PAUSE_S
        step = datetime.timedelta(seconds=max(step_s, LEAST_STEP_S))
        last = self._last_moment
        self._last_moment = datetime.datetime.now() if last is None else last + step
        self._last_s = time_s
        return self._last_moment

    def _failed(self, error: Exception) -> None:
        reason = getattr(error, "strerror", None) or str(error)
        self.notices.report(f"{self.folder}: cannot be written to; driving continues", reason)
