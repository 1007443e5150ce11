"""The live page of a drive: the files of `static/`, the state they poll, and their commands.

Slow calls run in threads of their own, outside the thread that serves the sockets.
"""

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Any, TypeVar

import eventlet
import torch
from pydantic import Field, StringConstraints

from datamodules.image import encode_image
from zoo.base.errors import InputError
from zoo.base.page_requests import Answer, RequestError, ServedPage, json_answer, read_command
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.runs.result_table import known
from zoo.scoring.visual_backprop import Saliency, overlay
from zoo.server.driver import Driver

POLL_MS = 100
MOST_POLLS = 50  # per second, of all pages; 300 doubled the 99th percentile of the latency
SALIENCY_S = 0.5  # least time between two drawings of the saliency
FRAME_S = 0.1  # least time between two encodings of a frame, which all pages share
MOST_LISTED = 50  # checkpoints in the list
QUALITY = 88  # of the JPEG images

Result = TypeVar("Result")
Mph = Annotated[float, Field(ge=0, le=100)]
Named = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
COMMANDS: dict[str, Any] = {"pause": bool, "record": bool, "set_mph": Mph, "switch": Named}


class PollInterval:
    """Poll interval that grows with the number of pages, so that they do not slow the driving.

    Attributes:
        poll_ms: milliseconds between two polls of a page.
    """

    def __init__(self) -> None:
        self.poll_ms = POLL_MS
        self._count, self._since_s = 0, 0.0

    def asked(self, now_s: float) -> None:
        """Count a poll of a page, and adapt `poll_ms` once a second.

        Args:
            now_s: time in seconds of a monotonic clock.
        """
        self._count += 1
        elapsed_s = now_s - self._since_s
        if elapsed_s >= 1:
            pages = self._count / elapsed_s * self.poll_ms / 1000
            self.poll_ms = round(max(POLL_MS, 1000 * pages / MOST_POLLS))
            self._count, self._since_s = 0, now_s


class LiveSaliency:
    """Saliency over the latest frame, computed in a thread, at most twice per second.

    Args:
        driver: driver whose policy and frames are shown.
    """

    def __init__(self, driver: Driver) -> None:
        self.driver = driver
        self._saliency: Saliency | None = None
        self._policy: object = None
        self._image, self._ended_s = b"", -math.inf
        self._turn = eventlet.Semaphore()

    def image(self) -> bytes:
        """Return a JPEG in the frame's size, `SALIENCY_S` old or less; empty without a frame.

        Raises:
            Exception: the saliency of this network cannot be computed.
        """
        with self._turn:
            if time.monotonic() - self._ended_s >= SALIENCY_S:
                self._image = call_in_thread(self._draw)
                self._ended_s = time.monotonic()
        return self._image

    def _draw(self) -> bytes:
        torch.set_num_threads(1)  # of this thread alone; the driver's thread keeps its number
        state, policy = self.driver.latest(), self.driver.policy
        if state.frame is None:
            return b""
        if self._saliency is None or policy is not self._policy:
            self._saliency, self._policy = Saliency(policy), policy
        shown = overlay(state.frame, self._saliency(state.frame, state.speed_mph))
        return encode_image(shown, quality=QUALITY)


class LivePage(ServedPage):
    """WSGI application of the live page, behind the `OriginGuard` of `DriveServer`.

    The page polls, and always gets the latest state. Nothing is queued, so that a slow browser
    polls less often.

    Args:
        driver: driver to show and command.
        folder: folder below which checkpoints are listed.
        token: see `ServedPage`.
    """

    def __init__(
        self, driver: Driver, folder: Path = Path("outputs"), token: str | None = None
    ) -> None:
        self.driver, self.folder = driver, folder
        self.loading = ""  # path of the checkpoint that is being loaded
        self.saliency, self.interval = LiveSaliency(driver), PollInterval()
        self._jpeg, self._encoded_s = b"", -math.inf
        answers: dict[str, Callable[[dict], Answer]] = {
            "/state.json": lambda query: self._poll(),
            "/checkpoints.json": lambda query: json_answer(
                call_in_thread(list_checkpoints, self.folder)
            ),
            "/frame.jpg": lambda query: (self._frame(), "image/jpeg"),
            "/saliency.jpg": lambda query: (self._saliency(), "image/jpeg"),
        }
        super().__init__(Path(__file__).parent / "static" / "live_page", answers, token)

    def _poll(self) -> Answer:
        self.interval.asked(time.monotonic())
        return json_answer(self.state())

    def state(self) -> dict:
        """Return the state of the drive as plain containers; None for unknown values."""
        latest, latency = self.driver.latest(), self.driver.tally.latency
        state = {name: value for name, value in vars(latest).items() if name != "frame"}
        if latest.overridden:  # the simulator sends no values while a person drives
            state |= {"steering": None, "throttle": None, "speed_mph": None}
        return state | {
            "time_s": time.monotonic(),
            "has_frame": latest.frame is not None,
            "latency_p50_ms": known(latency.percentile(50)),
            "latency_p99_ms": known(latency.percentile(99)),
            "loading": self.loading,
            "poll_ms": self.interval.poll_ms,
        }

    def _frame(self) -> bytes:
        now_s = time.monotonic()
        if now_s - self._encoded_s >= FRAME_S:
            frame = self.driver.latest().frame
            self._jpeg = b"" if frame is None else encode_image(frame, quality=QUALITY)
            self._encoded_s = now_s
        return _image(self._jpeg)

    def _saliency(self) -> bytes:
        try:
            image = self.saliency.image()
        except InputError as error:
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, str(error)) from None
        except Exception as error:  # the network may be of any kind
            line = f"no saliency for this network ({type(error).__name__}: {error})"
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, line) from None
        return _image(image)

    def _command(self, environ: dict) -> Answer:
        name, value = read_command(environ, COMMANDS)
        if name == "pause":
            self.driver.paused = value
        elif name == "record":
            self.driver.recording = value
        elif name == "switch":
            self._switch(value)
        else:
            try:
                self.driver.set_speed(value)
            except ValueError as error:
                raise RequestError(HTTPStatus.BAD_REQUEST, str(error)) from None
        return json_answer(self.state())

    def _switch(self, path: str) -> None:
        if self.loading:
            raise RequestError(HTTPStatus.CONFLICT, f"{self.loading} is loading; wait for it")
        self.loading = path
        try:
            call_in_thread(lambda: self.driver.switch(find_checkpoint(path)))
        except Exception as error:  # InputError, or any exception of torch for a strange file
            raise RequestError(HTTPStatus.BAD_REQUEST, str(error) or type(error).__name__) from None
        finally:
            self.loading = ""


def list_checkpoints(folder: Path) -> list[str]:
    """Return the paths of runs' checkpoints and of ONNX files below a folder, the newest first."""
    dated = []
    for path in (*folder.glob("**/checkpoints/*.ckpt"), *folder.glob("**/*.onnx")):
        try:
            dated.append((path.stat().st_mtime, str(path)))
        except OSError:  # a training has just replaced it
            continue
    return [path for _, path in sorted(dated, reverse=True)[:MOST_LISTED]]


def _image(image: bytes) -> bytes:
    if not image:
        raise RequestError(HTTPStatus.NOT_FOUND, "no frame received yet; connect a simulator")
    return image


def call_in_thread(function: Callable[..., Result], *arguments: object) -> Result:
    """Call a function in a new thread; return its result, or raise its exception.

    The calling green thread waits, while all other green threads run.

    >>> call_in_thread(max, 2, 3)
    3
    """
    future: Future[Result] = Future()

    def call() -> None:
        try:
            future.set_result(function(*arguments))
        except BaseException as error:
            future.set_exception(error)

    # Not eventlet's tpool, which can hang when the process ends (eventlet #989).
    threading.Thread(target=call, daemon=True).start()
    while not future.done():
        eventlet.sleep(0.02)
    return future.result()
