"""Recording in several processes: one drives, the others draw and encode the images.

Neither the expert nor a simulated student looks at images, and a frame depends only on the car's
pose, the weather and the frame's number. So this process drives all passes without drawing, other
processes draw the rows, and this process writes them in their order. The files are the same to the
byte as those of one process.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from rich.progress import Progress

from zoo.base.errors import InputError
from zoo.base.process_pool import KilledProcessError, ProcessPool, run_jobs
from zoo.simulator.recorder import Recorder, encode
from zoo.simulator.renderer import Renderer, open_buffer
from zoo.simulator.track_file import read_track
from zoo.simulator.udacity_car import FRAME_HEIGHT, FRAME_WIDTH
from zoo.simulator.weather import Weather
from zoo.simulator.world_settings import Quality

BATCH = 50  # rows that a process draws at a time

Pose = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Request:
    """A frame to draw.

    Attributes:
        scene: track, renderer and quality, as of `Renderer`.
        weather: arguments of `Renderer.set_weather`.
        frame: arguments of `Renderer.frame`.
    """

    scene: tuple[str, str, str]
    weather: tuple[Weather, int]
    frame: tuple[Pose, str, int]


class Requests:
    """A stand-in for `Renderer` that returns requests in place of frames; see `Renderer`."""

    def __init__(self, track: str, renderer: str = "auto", quality: Quality = "full") -> None:
        self.scene = track, renderer, quality
        engine, buffer, self.name = open_buffer(renderer, FRAME_WIDTH, FRAME_HEIGHT)
        engine.removeWindow(buffer)

    def set_weather(self, weather: Weather, seed: int) -> None:
        """Keep the weather of the next frames."""
        self.weather = weather, seed

    def frame(self, pose: Pose, camera: str, tick: int) -> Request:
        """Return a request; see `Renderer.frame`."""
        return Request(self.scene, self.weather, (pose, camera, tick))

    def close(self) -> None:
        """Do nothing, because no buffer is open."""


class ParallelRecorder:
    """A recorder of requests: at its end, processes draw them, and `recorder` writes the rows.

    It has the part of `Recorder` that `zoo.simulator.record.record` uses. After an error of the
    driver, too, it writes all rows that were added.

    Args:
        recorder: recorder of the drawn rows.
        jobs: number of processes that draw.
        progress: bars, to which it adds one for the images.
    """

    def __init__(self, recorder: Recorder, jobs: int, progress: Progress) -> None:
        self.rows, self.folder = 0, recorder.folder
        self._recorder, self._jobs, self._progress = recorder, jobs, progress
        self._passes: list[list[tuple[dict[str, Request], tuple[float, ...]]]] = []

    def __enter__(self) -> "ParallelRecorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if self.rows and (kind is None or issubclass(kind, InputError)):
            try:
                self._write()
            except KilledProcessError as killed:
                kept = f"the first {self._recorder.rows} rows are kept in {self.folder}"
                raise InputError(f"{killed}; {kept}") from None

    def begin_pass(self) -> None:
        """See `Recorder.begin_pass`."""
        self._passes.append([])

    def add(self, frames: dict[str, Request], *numbers: float) -> None:
        """Add a row; see `Recorder.add`."""
        self._passes[-1].append((frames, numbers))
        self.rows += 1

    def _write(self) -> None:
        # A process draws whole passes if there are enough, and so opens fewer tracks.
        size = self.rows if len(self._passes) >= 2 * self._jobs else BATCH
        batches = [
            (start == 0, rows[start : start + size])
            for rows in self._passes
            for start in range(0, len(rows), size)
        ]
        jobs = [([frames for frames, _ in rows],) for _, rows in batches]
        task = self._progress.add_task("images", total=1.0)
        drawn, written = {}, 0
        with ProcessPool(self._jobs, "jobs") as pool:
            sizes = [len(rows) for _, rows in batches]
            for job, images in run_jobs(
                pool, draw, jobs, lambda share: self._progress.update(task, completed=share), sizes
            ):
                drawn[job] = images
                while written in drawn:
                    is_first, rows = batches[written]
                    if is_first:
                        self._recorder.begin_pass()
                    for encoded, (_, numbers) in zip(drawn.pop(written), rows, strict=True):
                        self._recorder.add(encoded, *numbers)
                    written += 1


@lru_cache(maxsize=1)
def _opened(scene: tuple[str, str, Quality]) -> Renderer:
    """Return the renderer of a scene; the last one of a process stays open."""
    track, renderer, quality = scene
    return Renderer(read_track(track), renderer, quality)


@lru_cache(maxsize=1)
def _lit(scene: tuple[str, str, str], weather: tuple[Weather, int]) -> Renderer:
    """Return the renderer of a scene in a weather."""
    renderer = _opened(scene)
    renderer.set_weather(*weather)
    return renderer


def draw(
    rows: Sequence[dict[str, Request]], report: Callable[[float], None]
) -> list[dict[str, bytes]]:
    """Return the images of rows as JPEG, by camera; runs in a process of the pool."""
    drawn = []
    for row in rows:
        frames = {key: _lit(job.scene, job.weather).frame(*job.frame) for key, job in row.items()}
        drawn.append({camera: encode(frame) for camera, frame in frames.items()})
        report(len(drawn) / len(rows))
    return drawn
