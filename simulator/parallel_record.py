"""Recording in several processes: one drives, the others draw and encode the images.

Neither the expert nor a simulated student looks at images, and a frame depends only on the car's
pose, the weather and the frame's number. So this process drives all passes without drawing, other
processes draw the rows, and this process writes them in their order. The files are the same to the
byte as those of one process.
"""

import multiprocessing
import signal
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from types import TracebackType

import numpy as np

from simulator.errors import SimulatorError
from simulator.pictures import Pictures, open_buffer, open_pictures
from simulator.recorder import Recorder, encode
from simulator.rig import FRAME_HEIGHT, FRAME_WIDTH
from simulator.spawned_processes import hidden_script
from simulator.track_file import read_track
from simulator.weather import Weather

BATCH = 50  # rows that a process draws at a time
AHEAD = 3  # batches for each process that may wait

Pose = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Scene:
    """A world to draw: the arguments of `open_pictures`."""

    track: str
    renderer: str
    quality: str


@dataclass(frozen=True)
class Request:
    """A frame to draw: its scene, and the arguments of `set_weather` and `frame` of `Pictures`."""

    scene: Scene
    weather: tuple[Weather, int]
    frame: tuple[Pose, str, int]


class Requests:
    """A stand-in for `Pictures` that returns requests in place of frames.

    Args:
        scene: world that other processes draw.
        name: name of the renderer.
    """

    def __init__(self, scene: Scene, name: str) -> None:
        self.scene, self.name = scene, name

    def set_weather(self, weather: Weather, seed: int) -> None:
        """Keep the weather of the next frames."""
        self.weather = weather, seed

    def frame(self, pose: Pose, camera: str, tick: int) -> Request:
        """Return a request; see `Pictures.frame`."""
        return Request(self.scene, self.weather, (pose, camera, tick))

    def close(self) -> None:
        """Do nothing, because no buffer is open."""


def renderer_name(renderer: str) -> str:
    """Return the name of the renderer that opens on this machine; see `open_buffer`."""
    engine, buffer, name = open_buffer(renderer, FRAME_WIDTH, FRAME_HEIGHT)
    engine.removeWindow(buffer)
    return name


class ParallelRecorder:
    """A recorder of requests: `jobs` processes draw them, and `recorder` writes the rows.

    It has the part of `Recorder` that `simulator.record.record` uses. At its end, also after an
    error of the driver, it writes all rows that were added.

    Args:
        recorder: recorder of the drawn rows.
        jobs: number of processes that draw.
        whole_passes: whether a process draws a whole pass, because there are enough of them. This
            saves each process from opening each track.
    """

    def __init__(self, recorder: Recorder, jobs: int, whole_passes: bool) -> None:
        self.rows, self.folder = 0, recorder.folder
        self._recorder, self._jobs, self._whole_passes = recorder, jobs, whole_passes
        # Spawned, because Panda3D's threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(jobs, context, _begin_process)
        self._batch: list[tuple[dict[str, Request], tuple[float, ...]]] = []
        self._waiting: deque[tuple[Future, list[tuple[float, ...]]] | None] = deque()

    def __enter__(self) -> "ParallelRecorder":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None or issubclass(kind, SimulatorError):
                self._submit()
                self._write(0)
        finally:
            self._pool.shutdown(cancel_futures=True)

    def begin_pass(self) -> None:
        """See `Recorder.begin_pass`."""
        self._submit()
        self._waiting.append(None)

    def add(
        self,
        frames: dict[str, Request],
        steering: float,
        throttle: float,
        brake: float,
        speed_mph: float,
        time: float,
    ) -> None:
        """Add a row; see `Recorder.add`."""
        self._batch.append((frames, (steering, throttle, brake, speed_mph, time)))
        self.rows += 1
        if len(self._batch) == BATCH and not self._whole_passes:
            self._submit()

    def _submit(self) -> None:
        if self._batch:
            requests = [frames for frames, _ in self._batch]
            with hidden_script():
                future = self._pool.submit(draw, requests)
            self._waiting.append((future, [numbers for _, numbers in self._batch]))
            self._batch = []
        self._write(AHEAD * self._jobs)

    def _write(self, left: int) -> None:
        """Write the first batches until at most `left` wait."""
        while len(self._waiting) > left:
            first = self._waiting.popleft()
            if first is None:
                self._recorder.begin_pass()
                continue
            future, rows = first
            try:
                drawn = future.result()
            except BrokenProcessPool:
                raise SimulatorError(
                    f"jobs={self._jobs}: a process was killed, perhaps because memory ran out, "
                    f"after {self._recorder.rows} rows, which are kept in {self.folder}; try a "
                    "lower jobs="
                ) from None
            for images, numbers in zip(drawn, rows, strict=True):
                self._recorder.add_encoded(images, *numbers)


class Drawing:
    """The renderer of the latest scene, in a process of the pool."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._weather: tuple[Weather, int] | None = None
        self._pictures: Pictures | None = None

    def frame(self, request: Request) -> np.ndarray:
        """Return the requested frame, uint8 [160, 320, 3], RGB."""
        if request.scene != self._scene:
            if self._pictures is not None:
                self._pictures.close()
            scene = request.scene
            self._pictures = open_pictures(read_track(scene.track), scene.renderer, scene.quality)
            self._scene, self._weather = scene, None
        if request.weather != self._weather:
            self._pictures.set_weather(*request.weather)
            self._weather = request.weather
        return self._pictures.frame(*request.frame)


_drawing = Drawing()


def draw(rows: Sequence[dict[str, Request]]) -> list[dict[str, bytes]]:
    """Return the images of rows as JPEG, by camera; runs in a process of the pool."""
    return [{camera: encode(_drawing.frame(one)) for camera, one in row.items()} for row in rows]


def _begin_process() -> None:
    """End without a traceback on Ctrl-C; the recording process prints a line."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
