"""The live page of a drive: the files of `static/`, the state they poll, and their commands."""

import hmac
import math
import time
from collections.abc import Callable, Iterable
from http import HTTPStatus
from pathlib import Path
from urllib.parse import parse_qs

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.drive.background_call import call_in_thread
from zoo.drive.driver import Driver
from zoo.drive.live_saliency import LiveSaliency, jpeg
from zoo.drive.page_requests import Answer, RequestError, json_answer, read_command, respond, route
from zoo.drive.poll_interval import PollInterval

FRAME_S = 0.1  # least time between two encodings of a frame, which all pages share
MOST_LISTED = 50  # checkpoints in the list
STATIC = Path(__file__).parent / "static"
FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/style.css": ("style.css", "text/css; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
}


class LivePage:
    """WSGI application of the live page, behind the `OriginGuard` of `DriveServer`.

    The page polls, and always gets the latest state. Nothing is queued, so that a slow browser
    polls less often.

    Args:
        driver: driver to show and command.
        folder: folder below which checkpoints are listed.
        token: token that the address of a command must contain, `?token=...`; None if only this
            machine can send commands.
    """

    def __init__(
        self, driver: Driver, folder: Path = Path("outputs"), token: str | None = None
    ) -> None:
        self.driver, self.folder, self.token = driver, folder, token
        self.loading = ""  # path of the checkpoint that is being loaded
        self.saliency, self.interval = LiveSaliency(driver), PollInterval()
        self._files = {
            path: ((STATIC / name).read_bytes(), kind) for path, (name, kind) in FILES.items()
        }
        self._jpeg, self._encoded_s = b"", -math.inf
        self._get = {
            "/state.json": lambda query: self._poll(),
            "/checkpoints.json": lambda query: json_answer(
                call_in_thread(list_checkpoints, self.folder)
            ),
            "/frame.jpg": lambda query: (self._frame(), "image/jpeg"),
            "/saliency.jpg": lambda query: (self._saliency(), "image/jpeg"),
        }
        self._commands = {
            "pause": self._pause,
            "record": self._record,
            "set_mph": self._set_speed,
            "switch": self._switch,
        }

    def __call__(self, environ: dict, start_response: Callable) -> Iterable[bytes]:
        """Answer a request."""
        return respond(self._answer, environ, start_response)

    def _answer(self, environ: dict) -> Answer:
        return route(environ, self._files, self._get, self._command)

    def _poll(self) -> tuple[bytes, str]:
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
            "latency_p50_ms": _known(latency.percentile(50)),
            "latency_p99_ms": _known(latency.percentile(99)),
            "loading": self.loading,
            "poll_ms": self.interval.poll_ms,
        }

    def _frame(self) -> bytes:
        now_s = time.monotonic()
        if now_s - self._encoded_s >= FRAME_S:
            frame = self.driver.latest().frame
            self._jpeg, self._encoded_s = b"" if frame is None else jpeg(frame), now_s
        return _image(self._jpeg)

    def _saliency(self) -> bytes:
        try:
            return _image(self.saliency.image())
        except RequestError:
            raise
        except InputError as error:
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, str(error)) from None
        except Exception as error:  # the network may be of any kind
            line = f"no saliency for this network ({type(error).__name__}: {error})"
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, line) from None

    def _command(self, environ: dict) -> tuple[bytes, str]:
        given = parse_qs(environ.get("QUERY_STRING", "")).get("token", [""])[0]
        if self.token and not hmac.compare_digest(given.encode(), self.token.encode()):
            line = (
                "token: wrong or missing; open the address with ?token= that drivezoo drive printed"
            )
            raise RequestError(HTTPStatus.FORBIDDEN, line)
        name, value = read_command(environ, self._commands)
        self._commands[name](value)
        return json_answer(self.state())

    def _pause(self, value: object) -> None:
        self.driver.paused = _true_or_false("pause", value)

    def _record(self, value: object) -> None:
        self.driver.recording = _true_or_false("record", value)

    def _set_speed(self, value: object) -> None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise RequestError(HTTPStatus.BAD_REQUEST, f"set_mph: {value!r:.40} is not a number")
        try:
            self.driver.set_speed(value)
        except (ValueError, OverflowError) as error:
            raise RequestError(HTTPStatus.BAD_REQUEST, str(error)) from None

    def _switch(self, value: object) -> None:
        if not isinstance(value, str) or not value.strip():
            raise RequestError(HTTPStatus.BAD_REQUEST, "switch: must be the path of a checkpoint")
        if self.loading:
            raise RequestError(HTTPStatus.CONFLICT, f"{self.loading} is loading; wait for it")
        self.loading = value.strip()
        try:
            call_in_thread(lambda named: self.driver.switch(find_checkpoint(named)), self.loading)
        except Exception as error:  # InputError, or any exception of torch for a strange file
            raise RequestError(HTTPStatus.BAD_REQUEST, str(error) or type(error).__name__) from None
        finally:
            self.loading = ""


def list_checkpoints(folder: Path) -> list[str]:
    """Return the paths of runs' checkpoints and of ONNX files below a folder, the newest first."""
    found = []
    for path in (*folder.glob("**/checkpoints/*.ckpt"), *folder.glob("**/*.onnx")):
        try:
            found.append((path.stat().st_mtime, str(path)))
        except OSError:  # a training has just replaced it
            continue
    return [path for _, path in sorted(found, reverse=True)[:MOST_LISTED]]


def _image(image: bytes) -> bytes:
    if not image:
        raise RequestError(HTTPStatus.NOT_FOUND, "no frame received yet; connect a simulator")
    return image


def _true_or_false(name: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise RequestError(HTTPStatus.BAD_REQUEST, f"{name}: {value!r:.40} is not true or false")
    return value


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
