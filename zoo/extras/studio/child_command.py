"""A command of drivezoo as a child process, with the lines that it prints."""

import re
import subprocess
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from zoo.base.child_process import end_module, start_module
from zoo.base.limits import parse_number
from zoo.base.terminal import command_line, printable
from zoo.runs.status import NAME, read_status

MOST_LINES = 200  # the last ones
LOG = "log.txt"  # of a sweep's job
STOPS_S = 60.0  # that a training may take to complete its files
EPOCH = re.compile(r"epoch +(\d+)/(\d+) +train/loss ([-\w.]+)(?:.*?([\d,]+) samples/s)?")


class ChildCommand:
    """A command that runs, or has run.

    Args:
        words: words after `drivezoo`.
    """

    def __init__(self, words: Sequence[str]) -> None:
        self.line = command_line(["drivezoo", *words])
        self.lines: deque[str] = deque(maxlen=MOST_LINES)
        self.epochs: list[tuple[float, int, int, str, str]] = []
        self._logged: dict[Path, int] = {}  # lines of a log that were read
        # In a session of its own: Ctrl-C in the terminal is the studio's, which then stops it.
        self._process = start_module(
            "zoo.base.console_script",
            *words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._take(line)
        self._process.wait()

    def _take(self, line: str) -> None:
        self.lines.append(printable(line.rstrip()))
        if match := EPOCH.match(line):
            done, most, loss, rate = match.groups()
            self.epochs.append((time.monotonic(), int(done), int(most), loss, rate or ""))

    def read_log(self, run: Path) -> None:
        """Read what is new in the log of a sweep's job, which prints nothing; others have none."""
        with suppress(OSError):
            lines = (run / LOG).read_text(encoding="utf-8", errors="replace").splitlines()
            for line in lines[self._logged.get(run, 0) :]:
                self._take(line)
            self._logged[run] = len(lines)

    @property
    def running(self) -> bool:
        """Whether it runs."""
        return self._thread.is_alive()

    @property
    def status(self) -> int | None:
        """Return the exit status; None while it runs."""
        return None if self.running else self._process.returncode

    def stop(self) -> None:
        """Stop it as Ctrl-C does, and wait until its files are whole."""
        if self.running:
            end_module(self._process, STOPS_S)
            self._thread.join()

    def wait(self, seconds: float) -> None:
        """Wait until it ends, for some seconds at most."""
        self._thread.join(seconds)

    def state(self) -> dict[str, Any]:
        """Return the state as plain containers."""
        return {"line": self.line, "lines": list(self.lines), "status": self.status}

    def training(self, trainings: int = 1) -> dict[str, Any]:
        """Return the last epoch, its loss, samples per second and the seconds left, if known.

        Args:
            trainings: trainings that the command runs, one after the other.
        """
        if not self.epochs:
            return {}
        first, last = self.epochs[0], self.epochs[-1]
        # A resumed training begins at a later epoch.
        begun = 1 + sum(number == 1 for _, number, *_ in self.epochs[1:])
        left_s = None
        if len(self.epochs) > 1:
            epoch_s = (last[0] - first[0]) / (len(self.epochs) - 1)
            left = (last[2] - last[1]) + (trainings - begun) * last[2]
            left_s = max(left * epoch_s - (time.monotonic() - last[0]), 0.0)
        _, epoch, epochs, loss, rate = last
        facts = {"epoch": epoch, "epochs": epochs, "loss": parse_number(loss), "left_s": left_s}
        return facts | {"rate": float(rate.replace(",", "")) if rate else None}

    def run_folder(self, outputs: Path) -> Path | None:
        """Return the folder of the newest run that the process has claimed; None before."""
        runs, pid = begun_runs(outputs), self._process.pid
        ours = [run for run in runs if read_status(run).get("pid") == pid]
        return max(ours, key=lambda run: (run / NAME).stat().st_mtime) if ours else None


def begun_runs(outputs: Path) -> list[Path]:
    """Return the folders of trainings, also of those that have no checkpoint yet."""
    paths = [*outputs.glob(f"*/*/{NAME}"), *outputs.glob(f"sweeps/*/*/*/{NAME}")]
    return [path.parent for path in paths]
