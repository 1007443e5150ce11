"""The editing page: the files of `static/`, the recording's columns and images, and commands."""

import math
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import numpy as np

from datamodules.image import encode_image, find_fault, read_stored
from datamodules.recording import file_name
from datamodules.split import rows_per_second
from datamodules.stretches import find_breaks
from zoo.base.errors import InputError
from zoo.base.page_requests import Answer, RequestError, ServedPage, json_answer, read_command
from zoo.server.edit_session import EditSession, FrameAnalysis

STRETCH_EDITS = ("drop", "restore", "trim", "mirror", "merge")
COMMANDS = dict.fromkeys((*STRETCH_EDITS, "split", "undo", "redo", "write"), Any)


class EditPage(ServedPage):
    """WSGI application of the page.

    A request names a row and a camera, never a path: the page shows only images of the recording,
    and writes only to the folder that the command line chose.

    Args:
        session: edits of the recording.
        analysis: analysis of its frames.
        checkpoint: path of the checkpoint that predicts, for the page; empty without one.
    """

    def __init__(self, session: EditSession, analysis: FrameAnalysis, checkpoint: str = "") -> None:
        self.session, self.analysis, self.checkpoint = session, analysis, checkpoint
        self.recording = session.recording
        answers: dict[str, Callable[[dict], Answer]] = {
            "/recording.json": lambda query: json_answer(self.about()),
            "/columns.bin": lambda query: (self._columns(), "application/octet-stream"),
            "/predicted.bin": self._predicted,
            "/state.json": lambda query: json_answer(self.state()),
            "/notable.json": lambda query: json_answer(self.notable()),
            "/row.json": lambda query: json_answer(self.describe(self._row(query))),
            "/image": self._image,
        }
        super().__init__(Path(__file__).parent / "static" / "edit_page", answers)

    def about(self) -> dict:
        """Return what does not change: names, sizes, pauses, cameras and the checkpoint."""
        recording = self.recording
        return {
            "names": recording.names,
            "rows": len(recording),
            "cameras": [any(path is not None for path in column) for column in recording.images.T],
            "breaks": (np.flatnonzero(find_breaks(recording)) + 1).tolist(),
            "rows_per_second": rows_per_second(recording),
            "times": bool(np.isfinite(recording.time_s).any()),
            "bad_images": len(recording.bad_images),
            "checkpoint": self.checkpoint,
        }

    def _columns(self) -> bytes:
        """Return steering, speed in mph and seconds since the first row, float32 [3, N]."""
        steering, time_s = self.recording.steering, self.recording.time_s
        columns = (steering, self.recording.known_speed_mph, time_s - time_s[0])
        return np.stack(columns).astype("<f4").tobytes()

    def _predicted(self, query: dict) -> Answer:
        """Return rows and predicted steering after the first `known` ones, float32 [2, M]."""
        count = _number(query, "known", len(self.recording))
        columns = np.stack([row.astype("<f4") for row in self.analysis.predicted_after(count)])
        return columns.tobytes(), "application/octet-stream"

    def state(self) -> dict:
        """Return what changes: the edits, the writing and the analysis."""
        return self.session.state() | {"analysed": self.analysis.done}

    def notable(self) -> dict:
        """Return the notable rows by kind, as pairs of row and value; null for infinity."""
        return {
            kind: [(row.row, row.value if math.isfinite(row.value) else None) for row in rows]
            for kind, rows in self.analysis.notable().items()
        }

    def describe(self, row: int) -> dict:
        """Return a row's place in its log, its centre image's name, and its pedals."""
        recording = self.recording
        return {
            "row": row,
            "place": recording.place(row),
            "image": file_name(str(recording.images[row, 0])),
            "throttle": float(recording.throttle[row]),
            "brake": float(recording.brake[row]),
        }

    def _image(self, query: dict) -> Answer:
        """Return a row's image as it was recorded."""
        path = self.recording.images[self._row(query), _number(query, "camera", 2)]
        if path is None:
            raise RequestError(HTTPStatus.NOT_FOUND, "this camera has no image in this row")
        try:
            data = read_stored(path)
        except (OSError, ValueError, InputError) as error:
            line = f"{path}: {getattr(error, 'strerror', None) or error}"
            raise RequestError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, line) from None
        if not isinstance(data, bytes):
            return encode_image(data), "image/jpeg"
        # A log may name any file of the user; only images leave the process.
        if fault := find_fault(data):
            raise RequestError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"{path}: {fault}")
        return data, "image/png" if data.startswith(b"\x89PNG") else "image/jpeg"

    def _row(self, query: dict) -> int:
        return _number(query, "row", len(self.recording) - 1)

    def _command(self, environ: dict) -> Answer:
        name, value = read_command(environ, COMMANDS)
        with self.session.lock:
            now = f"{self.session.name}.{self.session.changes}"
            if parse_qs(environ.get("QUERY_STRING", "")).get("shown", [now]) != [now]:
                line = "the edits were changed on another page, and are shown now; repeat yours"
                raise RequestError(HTTPStatus.CONFLICT, line)
            return self._apply(name, value)

    def _apply(self, name: str, value: object) -> Answer:
        if name == "write":
            if not self.session.start_writing():
                raise RequestError(HTTPStatus.CONFLICT, "the recording is being written; wait")
            return json_answer(self.state())
        if name in STRETCH_EDITS:
            value = _stretch(name, value)
        elif name == "split" and (isinstance(value, bool) or not isinstance(value, int)):
            raise RequestError(HTTPStatus.BAD_REQUEST, f"split: {value!r:.40} is no row")
        try:
            self.session.change(name, value)
        except InputError as error:
            raise RequestError(HTTPStatus.BAD_REQUEST, str(error)) from None
        return json_answer(self.state())


def _number(query: dict, key: str, most: int) -> int:
    text = query.get(key, ["0"])[0]
    if not (text.isascii() and text.isdecimal() and len(text) < 13 and int(text) <= most):
        raise RequestError(HTTPStatus.BAD_REQUEST, f"{key}={text[:40]}: must be in 0..{most}")
    return int(text)


def _stretch(name: str, value: object) -> tuple[int, int]:
    match value:
        case [int(first), int(end)] if not isinstance(first, bool) and not isinstance(end, bool):
            return first, end
    line = f"{name}: {value!r:.40} is no pair of a first row and the row after the last"
    raise RequestError(HTTPStatus.BAD_REQUEST, line)
