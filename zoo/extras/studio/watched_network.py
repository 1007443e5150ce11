"""A network that drives in real time in a process of its own, and the page's side of it.

As a program: `CHECKPOINT SCENARIO`, the scenario as JSON. It writes each frame on its output: the
length and JSON of the state, then the length and the bytes of the JPEG.
"""

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import IO, Any

from zoo.base.child_process import end_module, limit_resource, start_module
from zoo.base.run_command import STOPPED
from zoo.simulator.hand_page import LatestFrame

MOST_BYTES = 4_000_000_000  # memory of a process; its files are limited to one hundredth
LOADS_S, SILENT_S = 90.0, 20.0  # for the first frame, and between two
MOST_FRAME = 4_000_000  # bytes


class Watched:
    """The page's side: a process, and its latest frame.

    Args:
        name: network, as the user names it.
        path: file of the network.
        scenario: values of a `Scenario`.
    """

    def __init__(self, name: str, path: str, scenario: dict[str, Any]) -> None:
        self.name, self.loading = name, True
        self.frame, self.failure, self.ready = LatestFrame(), "", threading.Event()
        self._heard_s, self._patience_s = time.monotonic(), LOADS_S
        self._process = start_module(
            "zoo.extras.studio.watched_network",
            path,
            json.dumps(scenario),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self._errors = b""
        for target in (self._read, self._note, self._watch):
            threading.Thread(target=target, daemon=True).start()

    @property
    def running(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    def begin(self) -> None:
        """Let the car start."""
        assert self._process.stdin is not None
        self._heard_s, self._patience_s = time.monotonic(), SILENT_S
        with suppress(OSError):  # it has ended
            self._process.stdin.write(b"\n")
            self._process.stdin.flush()

    def stop(self) -> None:
        """End the process."""
        if self.running:
            end_module(self._process)

    def state(self) -> dict[str, Any]:
        """Return the state as plain containers."""
        state = {"name": self.name, "running": self.running, "failure": self.failure}
        return state | {"loading": self.loading}

    def _read(self) -> None:
        pipe: Any = self._process.stdout
        while (head := _block(pipe)) is not None and (jpeg := _block(pipe)) is not None:
            self._heard_s = time.monotonic()
            if jpeg:
                self.frame.show(jpeg, **json.loads(head))
                self.loading = False
            else:
                self.ready.set()
        status = self._process.wait()
        self.ready.set()
        time.sleep(0.1)  # for the last line of its errors
        lines = self._errors.decode(errors="replace").strip().splitlines()
        if status in (STOPPED, -signal.SIGINT):
            self.failure = self.failure or "was stopped"
        elif status and not self.failure:
            self.failure = lines[-1] if status > 0 and lines else f"ended with {status}"

    def _note(self) -> None:
        pipe: Any = self._process.stderr
        while part := pipe.read1(1 << 12):
            self._errors = (self._errors + part)[-10_000:]

    def _watch(self) -> None:
        while self.running:
            waits = self.ready.is_set() and self._patience_s == LOADS_S  # for the other network
            if not waits and time.monotonic() - self._heard_s > self._patience_s:
                self.failure = f"gives no frame for {self._patience_s:.0f} s"
                self._process.kill()
            time.sleep(0.2)


def start_together(networks: list[Watched]) -> None:
    """Let the cars start at the same time, once all networks are loaded."""

    def wait() -> None:
        for network in networks:
            network.ready.wait()
        for network in networks:
            network.begin()

    threading.Thread(target=wait, daemon=True).start()


def _block(pipe: IO[bytes]) -> bytes | None:
    """Return the next block; None at the end, or if it is too large."""
    head = pipe.read(4)
    size = int.from_bytes(head, "little")
    if len(head) < 4 or size > MOST_FRAME:
        return None
    data = pipe.read(size)
    return data if len(data) == size else None


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def watch(words: list[str]) -> None:
    """Drive as the program's words say."""
    from zoo.driving.run_drives import Keep, all_drives  # slow imports
    from zoo.driving.scenario import Scenario
    from zoo.driving.tally import autonomy
    from zoo.simulator.recorder import encode

    # What libraries print must not stand between the frames.
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    limit_resource("RLIMIT_DATA", MOST_BYTES)
    limit_resource("RLIMIT_FSIZE", MOST_BYTES // 100)

    def write(state: dict, jpeg: bytes = b"") -> None:
        for block in (json.dumps(state).encode(), jpeg):
            output.write(len(block).to_bytes(4, "little") + block)
        output.flush()

    class Streamed(Keep):
        def begin(self, world: Any) -> None:
            self.interventions = 0
            write({})
            sys.stdin.readline()
            self.began_s = time.monotonic()

        def show(self, frame: Any, row: Any) -> None:
            self.interventions += row.intervention
            state = {name: _known(value) for name, value in vars(row).items() if name in SHOWN}
            state["interventions"] = self.interventions
            state["autonomy"] = _known(autonomy(self.interventions, row.time_s))
            write(state, encode(frame))
            time.sleep(max(self.began_s + row.time_s - time.monotonic(), 0))

    path, scenario = words
    all_drives(path, [Scenario(**json.loads(scenario)).one_drive()], Streamed())


SHOWN = ("time_s", "steering", "throttle", "speed_mph", "cross_track_m", "expert_steering")


if __name__ == "__main__":
    from zoo.base.run_command import exit_after

    exit_after("drivezoo studio", watch)
