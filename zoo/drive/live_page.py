"""The live page of a drive: `static/` in a browser, what it polls, and what its buttons do."""

import hmac
import json
import math
import time
from collections.abc import Callable, Iterable
from http import HTTPStatus
from pathlib import Path
from urllib.parse import parse_qs

from datamodules.errors import InputError
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.drive.background_call import beside
from zoo.drive.driver import Driver
from zoo.drive.live_saliency import Gaze, jpeg
from zoo.drive.poll_interval import Pace

FRAME_S = 0.1  # a frame is encoded once for all who look within this time
MOST_COMMAND = 4096  # bytes
MOST_LISTED = 50  # checkpoints
STATIC = Path(__file__).parent / "static"
FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/style.css": ("style.css", "text/css; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
}
# Another site can neither frame the page, to have its buttons clicked, nor show its pictures.
HEADERS = [
    ("Cache-Control", "no-store"),
    (
        "Content-Security-Policy",
        "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'",
    ),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),  # the address may hold the token
]


class RequestError(Exception):
    """A request that cannot be served: its status, and a line for the person."""

    def __init__(self, status: HTTPStatus, line: str) -> None:
        super().__init__(line)
        self.status = status


class LivePage:
    """A WSGI application, which `DriveServer` puts behind its `OriginGuard`.

    The page polls. What it gets is the latest there is: nothing is queued for it, and a browser
    that is slow asks less often.

    Args:
        driver: that is shown, and commanded.
        folder: below which checkpoints are listed.
        token: must be in the address of a command, `?token=...`; None where only this machine can
            send one.
    """

    def __init__(
        self, driver: Driver, folder: Path = Path("outputs"), token: str | None = None
    ) -> None:
        self.driver, self.folder, self.token = driver, folder, token
        self.loading = ""  # the checkpoint that is being switched to
        self.gaze, self.pace = Gaze(driver), Pace()
        self._files = {
            path: ((STATIC / name).read_bytes(), kind) for path, (name, kind) in FILES.items()
        }
        self._jpeg, self._encoded_s = b"", -math.inf
        self._get = {
            "/state.json": self._poll,
            "/checkpoints.json": lambda: _json(beside(list_checkpoints, self.folder)),
            "/frame.jpg": lambda: (self._frame(), "image/jpeg"),
            "/saliency.jpg": lambda: (self._saliency(), "image/jpeg"),
        }
        self._commands = {
            "pause": self._pause,
            "record": self._record,
            "set_mph": self._set_speed,
            "switch": self._switch,
        }

    def __call__(self, environ: dict, start_response: Callable) -> Iterable[bytes]:
        status = HTTPStatus.OK
        try:
            body, kind = self._answer(environ)
        except RequestError as error:
            status = error.status
            body, kind = _json({"error": str(error)})
        length = ("Content-Length", str(len(body)))
        start_response(
            f"{status.value} {status.phrase}", [("Content-Type", kind), length, *HEADERS]
        )
        return [body]

    def _answer(self, environ: dict) -> tuple[bytes, str]:
        method, path = environ["REQUEST_METHOD"], environ.get("PATH_INFO", "")
        if path == "/command":
            if method != "POST":
                raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, "a command is a POST")
            return self._command(environ)
        if path not in self._files and path not in self._get:
            raise RequestError(HTTPStatus.NOT_FOUND, f"there is no {path[:80]}; the page is at /")
        if method != "GET":
            raise RequestError(HTTPStatus.METHOD_NOT_ALLOWED, "this is read with GET")
        return self._files[path] if path in self._files else self._get[path]()

    def _poll(self) -> tuple[bytes, str]:
        self.pace.asked(time.monotonic())
        return _json(self.state())

    def state(self) -> dict:
        """How the drive stands, plain; None for what is not known."""
        latest, latency = self.driver.latest(), self.driver.tally.latency
        state = {name: value for name, value in vars(latest).items() if name != "frame"}
        if latest.overridden:  # the simulator tells nothing while a person drives
            state |= {"steering": None, "throttle": None, "speed_mph": None}
        return state | {
            "time_s": time.monotonic(),
            "has_frame": latest.frame is not None,
            "latency_p50_ms": _known(latency.percentile(50)),
            "latency_p99_ms": _known(latency.percentile(99)),
            "loading": self.loading,
            "poll_ms": self.pace.poll_ms,
        }

    def _frame(self) -> bytes:
        now_s = time.monotonic()
        if now_s - self._encoded_s >= FRAME_S:
            frame = self.driver.latest().frame
            self._jpeg, self._encoded_s = b"" if frame is None else jpeg(frame), now_s
        return _picture(self._jpeg)

    def _saliency(self) -> bytes:
        try:
            return _picture(self.gaze.picture())
        except RequestError:
            raise
        except InputError as error:
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, str(error)) from None
        except Exception as error:  # any network may be driving
            line = f"this network cannot be looked through ({type(error).__name__}: {error})"
            raise RequestError(HTTPStatus.SERVICE_UNAVAILABLE, line) from None

    def _command(self, environ: dict) -> tuple[bytes, str]:
        given = parse_qs(environ.get("QUERY_STRING", "")).get("token", [""])[0]
        if self.token and not hmac.compare_digest(given.encode(), self.token.encode()):
            line = "the buttons need the address with ?token=... that the driver printed"
            raise RequestError(HTTPStatus.FORBIDDEN, line)
        # A form of another site cannot send JSON, nor can its script without being asked for the
        # Origin, which the guard has seen to.
        if environ.get("CONTENT_TYPE", "").partition(";")[0].strip() != "application/json":
            raise RequestError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "a command is application/json")
        length = environ.get("CONTENT_LENGTH") or ""
        if not length.isdecimal() or int(length) > MOST_COMMAND:
            line = f"a command has a Content-Length, up to {MOST_COMMAND}"
            raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, line)
        try:
            command = json.loads(environ["wsgi.input"].read(int(length)))
        except (ValueError, RecursionError):
            raise RequestError(HTTPStatus.BAD_REQUEST, "this is no JSON") from None
        if (
            not isinstance(command, dict)
            or len(command) != 1
            or not set(command) & {*self._commands}
        ):
            known = ", ".join(self._commands)
            raise RequestError(
                HTTPStatus.BAD_REQUEST, f"a command is an object with one of {known}"
            )
        ((name, value),) = command.items()
        self._commands[name](value)
        return _json(self.state())

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
            raise RequestError(HTTPStatus.BAD_REQUEST, "switch: name a checkpoint's path")
        if self.loading:
            raise RequestError(HTTPStatus.CONFLICT, f"{self.loading} is being loaded, wait for it")
        self.loading = value.strip()
        try:
            beside(lambda named: self.driver.switch(find_checkpoint(named)), self.loading)
        except Exception as error:  # InputError, or whatever a file of any kind makes torch raise
            raise RequestError(HTTPStatus.BAD_REQUEST, str(error) or type(error).__name__) from None
        finally:
            self.loading = ""


def list_checkpoints(folder: Path) -> list[str]:
    """The checkpoints of runs below a folder, and ONNX files, the newest first."""
    found = []
    for path in (*folder.glob("**/checkpoints/*.ckpt"), *folder.glob("**/*.onnx")):
        try:
            found.append((path.stat().st_mtime, str(path)))
        except OSError:  # a run that goes on has just replaced it
            continue
    return [path for _, path in sorted(found, reverse=True)[:MOST_LISTED]]


def _picture(picture: bytes) -> bytes:
    if not picture:
        raise RequestError(HTTPStatus.NOT_FOUND, "no frame has come yet")
    return picture


def _true_or_false(name: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise RequestError(HTTPStatus.BAD_REQUEST, f"{name}: {value!r:.40} is not true or false")
    return value


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _json(value: object) -> tuple[bytes, str]:
    return json.dumps(value).encode(), "application/json"
