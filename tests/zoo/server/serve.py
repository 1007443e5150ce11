"""`python -m tests.zoo.server.serve FOLDER [PATIENCE_S|doubt]`: a driver as a process for tests.

Its policy needs no torch: it steers by the image's redness, and fails for two colours. With `doubt`
it also predicts a spread, and the driver serves the live page. At the end the process prints the
number of sessions and tasks that it holds for clients; see `Served.held`.
"""

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import cv2
import numpy as np

from tests.zoo.command_runs import start
from tests.zoo.forked_commands import ForkedProcess

WHITE, BLACK = (255, 255, 255), (0, 0, 0)  # colours for which the policy returns NaN, and raises


def red_policy(frame: np.ndarray, speed_mph: float) -> tuple[float, None]:
    """Return the mean of the red channel, 0..1, as steering."""
    if frame.mean() > 250:
        return float("nan"), None
    if frame.mean() < 5:
        raise RuntimeError("it is dark")
    return float(frame[..., 0].mean()) / 255, None


def doubting_policy(frame: np.ndarray, speed_mph: float) -> tuple[float, None, float]:
    """Return the mean of the blue channel, 0..1, as spread of the steering."""
    return *red_policy(frame, speed_mph), float(frame[..., 2].mean()) / 255


def picture(
    colour: tuple[int, int, int], width: int = 320, height: int = 160, kind: str = ".jpg"
) -> bytes:
    """Return the encoded image of one RGB colour."""
    pixels = np.full((height, width, 3), colour[::-1], np.uint8)
    return cv2.imencode(kind, pixels)[1].tobytes()


# An image, and the driver's replies to it and to what cannot be used.
RED = picture((204, 0, 0))
FINE = ("steer", {"steering_angle": "0.8000", "throttle": "0.2000"})
NOTHING = ("steer", {"steering_angle": "0", "throttle": "0"})


class Served:
    """A driver's process; `lines` holds what it printed until `stop`."""

    def __init__(self, process: subprocess.Popen | ForkedProcess, folder: Path) -> None:
        self.process, self.folder = process, folder
        self.lines: list[str] = []
        self.port = self._port()

    def _port(self) -> int:
        for line in self.process.stdout:
            self.lines.append(line.strip())
            if line.startswith("listening on "):
                return int(line.split()[2].rpartition(":")[2])
        raise AssertionError(f"it did not start: {self.lines}")

    def held(self) -> tuple[int, int]:
        """Stop the driver; return the numbers of sessions and tasks that it held for clients."""
        assert self.stop() == 0
        (line,) = (line for line in self.lines if line.startswith("holds "))
        return int(line.split()[1]), int(line.split()[4])

    def stop(self) -> int:
        """End the driver as Ctrl-C does; return its exit status."""
        if self.process.returncode is None:
            self.process.send_signal(signal.SIGINT)
            self.lines += self.process.communicate(timeout=60)[0].splitlines()
        return self.process.returncode


@contextlib.contextmanager
def served(folder: Path, *command: str) -> Iterator[Served]:
    """Yield a serving process: this module's, or another command (a module and its arguments)."""
    process = start(folder.parent, *(command or ("tests.zoo.server.serve", str(folder))))
    try:
        driver = Served(process, folder)
        yield driver
        driver.stop()
    finally:
        process.kill()
        process.wait()


def main(folder: str, option: str | None = None) -> None:
    import gc

    from engineio.socket import Socket
    from eventlet.greenthread import GreenThread

    from zoo.base.notices import Notices
    from zoo.commands.drive import StopOnSignal
    from zoo.driving.speed_controller import Constant, SteeringFilter
    from zoo.server import connections, socketio_server
    from zoo.server.drive_writer import BackgroundWriter
    from zoo.server.driver import Driver
    from zoo.server.server import DriveServer, listen

    stop, notices = StopOnSignal(), Notices()
    writer = BackgroundWriter(Path(folder), notices)
    policy = doubting_policy if option == "doubt" else red_policy
    driver = Driver(policy, Constant(0.2), SteeringFilter(), writer, notices, record=True)
    page = None
    if option == "doubt":
        from zoo.server.live_page import LivePage

        page = LivePage(driver)
    server = DriveServer(driver, listen("127.0.0.1", 0), page)
    line = f"listening on http://127.0.0.1:{server.port}"
    if option and page is None:
        connections.HEAD_S = connections.QUIET_S = socketio_server.QUIET_S = float(option)
    with stop:
        server.serve(lambda: notices.print(line), lambda: stop.asked)
    gc.collect()
    tasks = sum(isinstance(obj, GreenThread) and not obj.dead for obj in gc.get_objects())
    sessions = sum(isinstance(obj, Socket) for obj in gc.get_objects())
    print(f"holds {sessions} sessions and {tasks} tasks", flush=True)
    server.close()
    driver.end(datetime.now())


if __name__ == "__main__":
    main(*sys.argv[1:])
