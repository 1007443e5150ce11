"""Recording in several processes: one drives, the others draw and encode the images.

Neither the expert nor a simulated student looks at images, and a frame depends only on the car's
pose, the weather and the frame's number. So this process drives all passes without drawing, other
processes draw the rows, and this process writes them in their order. The files are the same to the
byte as those of one process.
"""

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import TracebackType

import numpy as np

from simulator.recorder import Recorder, encode
from simulator.renderer import Renderer, open_buffer, open_renderer
from simulator.rig import FRAME_HEIGHT, FRAME_WIDTH
from simulator.track_file import read_track
from simulator.weather import Weather
from zoo.base.errors import InputError
from zoo.base.process_pool import LOOK_S, KilledProcessError, ProcessPool

BATCH = 50  # rows that a process draws at a time
AHEAD = 3  # batches for each process that may wait

Pose = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Scene:
    """A world to draw: the arguments of `open_renderer`."""

    track: str
    renderer: str
    quality: str


@dataclass(frozen=True)
class Request:
    """A frame to draw: its scene, and the arguments of `set_weather` and `frame` of `Renderer`."""

    scene: Scene
    weather: tuple[Weather, int]
    frame: tuple[Pose, str, int]


class Requests:
    """A stand-in for `Renderer` that returns requests in place of frames.

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
        """Return a request; see `Renderer.frame`."""
        return Request(self.scene, self.weather, (pose, camera, tick))

    def close(self) -> None:
        """Do nothing, because no buffer is open."""


def renderer_name(renderer: str) -> str:
    """Return the name of the renderer that opens on this machine; see `open_buffer`."""
    engine, buffer, name = open_buffer(renderer, FRAME_WIDTH, FRAME_HEIGHT)
    engine.removeWindow(buffer)
    return name


@dataclass
class _Batch:
    """Rows that a process draws: their requests and numbers, metres, and the job's number."""

    requests: list[dict[str, Request]] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    metres: float = 0.0
    show: Callable[[float], None] = lambda metres: None
    job: int = -1


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
        self._pool = ProcessPool(jobs, "jobs")
        self._batch = _Batch()
        self._waiting: deque[_Batch | None] = deque()  # None between two passes
        self._drawn: dict[int, list[dict[str, bytes]]] = {}  # by number of the job
        self._driven: Counter[Callable[[float], None]] = Counter()  # metres of each pass
        self._written: Counter[Callable[[float], None]] = Counter()  # metres of its written rows

    def __enter__(self) -> "ParallelRecorder":
        self._pool.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None or issubclass(kind, InputError):
                self._submit()
                self._write(0)
        finally:
            self._pool.end()

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
        self._batch.requests.append(frames)
        self._batch.rows.append((steering, throttle, brake, speed_mph, time))
        self.rows += 1
        if len(self._batch.rows) == BATCH and not self._whole_passes:
            self._submit()
        self._take(0)

    def show_drawn(self, show: Callable[[float], None], metres: float) -> None:
        """Call `show` with the metres of a pass whose rows are drawn, which takes longer.

        Args:
            show: function of the metres, one for each pass.
            metres: metres of the pass that are driven.
        """
        self._batch.show = show
        self._batch.metres += metres - self._driven[show]
        self._driven[show] = metres

    def _submit(self) -> None:
        if self._batch.rows:
            self._batch.job = self._pool.submit(draw, self._batch.requests)
            self._waiting.append(self._batch)
        self._batch = _Batch()
        self._write(AHEAD * self._jobs)

    def _write(self, left: int) -> None:
        """Write the first batches until at most `left` wait."""
        while len(self._waiting) > left:
            first = self._waiting[0]
            if first is None:
                self._recorder.begin_pass()
            elif first.job in self._drawn:
                for images, numbers in zip(self._drawn.pop(first.job), first.rows, strict=True):
                    self._recorder.add_encoded(images, *numbers)
                self._written[first.show] += first.metres
            else:
                self._take(LOOK_S)
                continue
            self._waiting.popleft()

    def _take(self, wait_s: float) -> None:
        """Take what the processes have drawn, and show how far they are."""
        try:
            self._drawn.update(self._pool.finished(wait_s))
        except KilledProcessError as error:
            raise InputError(
                f"{error}; the first {self._recorder.rows} rows are kept in {self.folder}"
            ) from None
        metres = self._written.copy()
        for one in filter(None, self._waiting):
            share = 1.0 if one.job in self._drawn else self._pool.shares.get(one.job, 0.0)
            metres[one.show] += share * one.metres
        for show, drawn in metres.items():
            show(drawn)


class Drawing:
    """The renderer of the latest scene, in a process of the pool."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._weather: tuple[Weather, int] | None = None
        self._renderer: Renderer | None = None

    def frame(self, request: Request) -> np.ndarray:
        """Return the requested frame, uint8 [160, 320, 3], RGB."""
        if request.scene != self._scene:
            if self._renderer is not None:
                self._renderer.close()
            scene = request.scene
            self._renderer = open_renderer(read_track(scene.track), scene.renderer, scene.quality)
            self._scene, self._weather = scene, None
        if request.weather != self._weather:
            self._renderer.set_weather(*request.weather)
            self._weather = request.weather
        return self._renderer.frame(*request.frame)


_drawing = Drawing()


def draw(
    rows: Sequence[dict[str, Request]], report: Callable[[float], None]
) -> list[dict[str, bytes]]:
    """Return the images of rows as JPEG, by camera; runs in a process of the pool."""
    drawn = []
    for row in rows:
        drawn.append({camera: encode(_drawing.frame(one)) for camera, one in row.items()})
        report(len(drawn) / len(rows))
    return drawn
