"""The page of the studio: its files, what it polls, and its commands, which are steps."""

import datetime
import secrets
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from http import HTTPStatus
from io import StringIO
from pathlib import Path
from typing import Any, Literal
from urllib.parse import parse_qs

from rich.console import Console

from zoo.base.conf_files import choices
from zoo.base.console_script import extra_commands
from zoo.base.errors import InputError
from zoo.base.new_folder import free_folder
from zoo.base.page_requests import (
    HEADERS,
    Answer,
    RequestError,
    ServedPage,
    json_answer,
    read_command,
)
from zoo.base.terminal import command_line
from zoo.checkpoints.checkpoint_path import OUTPUTS, find_checkpoint, short_name
from zoo.extras.studio.child_command import ChildCommand
from zoo.extras.studio.steps import (
    DAYS,
    RECORDINGS,
    UPLOADS,
    DriveStep,
    Step,
    TrainStep,
    WatchStep,
    networks,
    recordings,
)
from zoo.extras.studio.watched_network import Watched, start_together
from zoo.runs.status import read_metrics, read_status
from zoo.simulator import hand_drive, hand_page
from zoo.simulator.command_options import DriveOptions
from zoo.simulator.hand_control import Hands
from zoo.simulator.track_names import track_names

MOST_UPLOAD = 200_000_000  # bytes
DRIVES = (".ckpt", ".onnx")
# Another extra imports networks of Keras.
KINDS = (*DRIVES, ".h5", ".keras") if "import" in extra_commands() else DRIVES
IMPORTS_S = 300.0
Room = Literal["drive", "train", "watch", "check", "edit", "preview", "rank"]
COMMANDS: dict[str, Any] = {**hand_page.COMMANDS, "line": Step, "start": Step, "stop": Room}
# A generated page has a policy of its own; here it has no part in this page's origin.
CSP = "Content-Security-Policy"
SANDBOX = [(CSP, "sandbox allow-scripts allow-popups"), *((n, v) for n, v in HEADERS if n != CSP)]
HTML = "text/html; charset=utf-8"


class StudioPage(ServedPage):
    """WSGI application of the studio, behind the `OriginGuard` of its server.

    Args:
        key: word that each request must contain, `?token=...`; None if only this machine can ask.
    """

    def __init__(self, key: str | None = None) -> None:
        self.seat = hand_page.Seat()
        self.children: dict[str, ChildCommand] = {}
        self.editors: dict[str, ChildCommand] = {}  # by line; each may have unwritten edits
        self.seeds = self.trainings = 1
        self.watched: list[Watched] = []
        self.drive: dict[str, Any] = {}
        self._driving: threading.Thread | None = None
        self._lock = threading.RLock()
        answers: dict[str, Callable[[dict], Answer]] = {
            "/frame": self.seat.answer,
            "/watch": self._watch,
            "/state.json": lambda query: json_answer(self.state()),
            "/choices.json": lambda query: json_answer(self.choices()),
            "/preview.png": lambda query: _file(OUTPUTS / "preview" / "fed_batch.png", "image/png"),
            "/film.mp4": lambda query: _file(self._in_run("drives/*/film.mp4"), "video/mp4"),
            "/report": lambda query: _file(self._in_run("report/index.html"), HTML),
            "/ranking": lambda query: _file(OUTPUTS / "leaderboard.html", HTML),
        }
        static = Path(__file__).with_name("static")
        super().__init__(static, answers, key, [hand_page.HAND_FILES])

    def close(self) -> None:
        """End the drive, and stop what runs as Ctrl-C does; print what it says then."""
        self.seat.take("press", "escape")
        for network in self.watched:
            network.stop()
        for child in dict.fromkeys([*self.children.values(), *self.editors.values()]):
            child.lines.clear()
            child.stop()
            for line in child.lines:  # how to resume a training, or an editor with its edits
                print(line)
        if self._driving:
            self._driving.join()

    def _answer(self, environ: dict) -> Answer:
        path, query = environ.get("PATH_INFO", ""), parse_qs(environ.get("QUERY_STRING", ""))
        if path in self._answers:
            self._check_token(query)
        try:
            if path == "/upload" and environ["REQUEST_METHOD"] == "POST":
                self._check_token(query)
                return json_answer({"network": take_upload(query.get("name", [""])[0], environ)})
            return super()._answer(environ)
        except InputError as error:
            raise RequestError(HTTPStatus.BAD_REQUEST, str(error)) from None

    def _headers(self, environ: dict) -> Sequence[tuple[str, str]]:
        return SANDBOX if environ.get("PATH_INFO") in ("/report", "/ranking") else HEADERS

    def _command(self, environ: dict) -> Answer:
        name, value = read_command(environ, COMMANDS)
        if name in hand_page.COMMANDS:
            self.seat.take(name, value)
            return json_answer({})
        if name == "line":
            return json_answer([command_line(["drivezoo", *words]) for words in value.commands()])
        with self._lock:
            if name == "start":
                self._start(value)
            else:
                self._stop(value)
        return json_answer(self.state())

    def _start(self, step: Any) -> None:
        words = step.commands()
        if isinstance(step, DriveStep):
            self._start_drive(step)
        elif isinstance(step, WatchStep):
            self._stop("watch")
            paths = [(name, str(find_checkpoint(name))) for name in step.drivers]
            self.watched = [Watched(name, path, step.keys()) for name, path in paths]
            start_together(self.watched)
        elif step.step == "edit":
            line = command_line(["drivezoo", *words[0]])
            if line not in self.editors or not self.editors[line].running:
                self.editors[line] = ChildCommand(words[0])
            self.children["edit"] = self.editors[line]
        else:
            earlier = self.children.get(step.step)
            if step.step == "train" and earlier and earlier.running:
                raise RequestError(HTTPStatus.CONFLICT, "a training runs; stop it first")
            self._stop(step.step)
            if isinstance(step, TrainStep) and step.step == "train":
                self.seeds = self.seeds if step.resume else step.seeds
                # A sweep trains its jobs in order.
                done = Path(step.resume).name if words[0][0] == "sweep" else ""
                self.trainings = self.seeds - (int(done) if done.isdecimal() else 0)
            self.children[step.step] = ChildCommand(words[0])

    def _stop(self, room: str) -> None:
        if room == "drive":
            self.seat.take("press", "escape")
        elif room == "watch":
            for network in self.watched:
                network.stop()
        elif room in self.children:
            self.children[room].stop()

    def _start_drive(self, step: DriveStep) -> None:
        if self._driving and self._driving.is_alive():
            raise RequestError(HTTPStatus.CONFLICT, "a drive is open; end it first")
        out = free_folder(RECORDINGS[0] / f"{datetime.datetime.now():%Y-%m-%d_%H-%M-%S}")
        options = DriveOptions(out=str(out), **step.keys())  # type: ignore[arg-type]
        self.seat.pressed()  # keys of an earlier drive
        self.seat.take("hands", Hands())
        self.drive = {"line": command_line(["drivezoo", *step.commands()[0], f"out={out}"])}
        self._driving = threading.Thread(target=self._drive, args=(options,), daemon=True)
        self._driving.start()

    def _drive(self, options: DriveOptions) -> None:
        console = Console(file=StringIO(), width=100, soft_wrap=True)
        recorded = None
        try:
            recorded = hand_drive.drive(options, console, self.seat)
        except Exception as error:
            console.print(str(error) or type(error).__name__, markup=False)
        text = console.file.getvalue()  # type: ignore[attr-defined]
        folder = short_name(recorded[0]) if recorded else ""
        self.drive |= {"lines": text.splitlines(), "folder": folder}

    def _watch(self, query: dict) -> Answer:
        side = query.get("side", ["0"])[0]
        if side not in ("0", "1") or int(side) >= len(self.watched):
            raise RequestError(HTTPStatus.NOT_FOUND, f"side={side:.10}: nothing drives there")
        return self.watched[int(side)].frame.answer(query)

    def state(self) -> dict[str, Any]:
        """Return what changes: the drive, the commands that run, and the networks."""
        driving = bool(self._driving and self._driving.is_alive())
        return {
            "drive": self.drive | {"running": driving},
            "training": self._training(),  # which may read a log
            **{room: child.state() for room, child in list(self.children.items())},
            "watch": [network.state() for network in self.watched],
        }

    def _training(self) -> dict[str, Any]:
        child = self.children.get("train")
        if child is None:
            return {}
        run = child.run_folder(OUTPUTS)
        if run is not None:
            child.read_log(run)
        facts = child.training(self.trainings)
        if run is None:
            return facts
        verdict = None if child.running else read_metrics(run).get("verdict")
        facts |= {"run": short_name(run), "status": read_status(run).get("status")}
        files = {"film": "drives/*/film.mp4", "report": "report", "drives": "checkpoints/*.ckpt"}
        return facts | {"verdict": verdict} | {key: any(run.glob(files[key])) for key in files}

    def _in_run(self, pattern: str) -> Path:
        child = self.children.get("train")
        run = child and child.run_folder(OUTPUTS)
        return next(iter(sorted(run.glob(pattern))), Path("none")) if run else Path("none")

    def choices(self) -> dict[str, Any]:
        """Return what there is to choose from."""
        return {
            "tracks": track_names(),
            "days": list(DAYS),
            "recordings": recordings(),
            "recipes": choices("experiment"),
            "augmentations": choices("augment"),
            "networks": networks(),
        }


def take_upload(name: str, environ: dict) -> str:
    """Write an uploaded file into the folder of uploads; return how a user names the network.

    A Keras file is imported, by the command.

    Raises:
        InputError: it is of no kind that drives, or cannot be imported.
        RequestError: it is too large, or does not arrive.
    """
    kind = Path(name).suffix.lower()
    if kind not in KINDS:
        raise InputError(f"{name[:80]}: is of no kind that drives; upload {', '.join(KINDS)}")
    length = environ.get("CONTENT_LENGTH") or ""
    # Python reads no number of thousands of digits.
    if not length.isdecimal() or len(length) > 9 or not 0 < int(length) < MOST_UPLOAD:
        line = f"{name[:80]}: must have 1 to {MOST_UPLOAD:,} bytes"
        raise RequestError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, line)
    word = "".join(letter for letter in Path(name).stem if letter.isalnum() or letter in "-_")
    path = UPLOADS / f"{word[:40] or 'network'}-{secrets.token_hex(4)}{kind}"
    try:
        UPLOADS.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            left = int(length)
            while left and (part := environ["wsgi.input"].read(min(left, 1 << 16))):
                left -= file.write(part)
        if left:
            raise OSError
    except OSError as error:
        with suppress(OSError):  # it was not created
            path.unlink()
        if error.strerror and not isinstance(error, ConnectionError | TimeoutError):
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        raise RequestError(HTTPStatus.REQUEST_TIMEOUT, "the file did not arrive") from None
    if kind in DRIVES:
        return short_name(path)
    out = path.with_suffix(".ckpt")
    child = ChildCommand(["import", str(path), f"out={out}", "drive=false"])
    child.wait(IMPORTS_S)
    child.stop()
    path.unlink(missing_ok=True)
    if not out.is_file():
        raise InputError(next(filter(None, reversed(child.lines)), f"{name}: cannot be imported"))
    return short_name(out)


def _file(path: Path, kind: str) -> Answer:
    with suppress(OSError):
        return path.read_bytes(), kind
    raise RequestError(HTTPStatus.NOT_FOUND, "there is none yet")
