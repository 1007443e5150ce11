"""The command `drivezoo simulator record track=lake laps=2 out=FOLDER`."""

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress, TaskID
from rich.table import Table

from zoo.base.errors import InputError, file_errors
from zoo.base.new_folder import RECIPE
from zoo.base.terminal import counted, print_written
from zoo.base.whole_file import json_text, write_new
from zoo.simulator.command_options import RecordOptions
from zoo.simulator.expert import Expert, ExpertSettings
from zoo.simulator.hand_control import REACTION_S, HumanControl
from zoo.simulator.parallel_record import ParallelRecorder, Requests
from zoo.simulator.recorder import LOG_NAME, Recorder, split_pedals
from zoo.simulator.simulated_world import World
from zoo.simulator.udacity_car import CAMERAS, PHYSICS_STEP_S

FIRST_TRY = ("train", "experiment=first_try")  # docs/recipes.md
BARS = " ▁▂▃▄▅▆▇█"
BINS = 41
STUCK_S = 10.0  # a driver that gains less than a metre in this time is stuck


@dataclass
class Driven:
    """Figures of one pass.

    Attributes:
        length: length of the track in metres.
        metres: metres driven along the lap.
        seconds: simulated seconds driven.
        frames: frames driven, recorded or not.
        lap_ends_s: simulated time at the end of each whole lap.
        cte: cross-track error of each recorded row in metres.
        steering: steering of each recorded row, -1..1.
        off_road: number of recorded rows in which the car was off the road.
    """

    length: float
    metres: float = 0.0
    seconds: float = 0.0
    frames: int = 0
    lap_ends_s: list[float] = field(default_factory=list)
    cte: list[float] = field(default_factory=list)
    steering: list[float] = field(default_factory=list)
    off_road: int = 0

    @property
    def lap_s(self) -> list[float]:
        """Return the simulated seconds of each whole lap."""
        return np.diff([0.0, *self.lap_ends_s]).tolist()

    def add_row(
        self,
        recorder: Recorder | ParallelRecorder,
        world: World,
        frames: dict[str, Any],
        command: tuple[float, float],
        seconds: float,
    ) -> None:
        """Record a row.

        Args:
            recorder: recorder of the row.
            world: world in which the car drives.
            frames: frame of each camera.
            command: steering and throttle, -1..1.
            seconds: simulated seconds since the pass began.
        """
        steering, throttle = command
        recorder.add(frames, steering, *split_pedals(throttle), world.car.speed_mph, seconds)
        self.cte.append(world.cte)
        self.steering.append(steering)
        self.off_road += world.off_road

    def note_lap(self, world: World) -> None:
        """Note the end of a lap, if the car has just completed one."""
        if world.lap > len(self.lap_ends_s):
            self.lap_ends_s.append(world.time)


def print_report(
    console: Console,
    recorder: Recorder,
    all_driven: list[Driven],
    wall_s: float,
    renderer: str,
) -> None:
    """Print a table of rows, laps, times, cross-track error and steering."""
    cte = np.abs(np.concatenate([driven.cte for driven in all_driven]))
    steering = np.concatenate([driven.steering for driven in all_driven])
    seconds = sum(driven.seconds for driven in all_driven)
    laps = sum(driven.metres / driven.length for driven in all_driven)
    lap_s = [f"{lap:.1f} s" for driven in all_driven for lap in driven.lap_s]
    frames = sum(driven.frames for driven in all_driven)
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_row("rows", f"{recorder.rows:,} ({recorder.rows / frames:.0%} of the frames)")
    table.add_row("images", f"{3 * recorder.rows:,}")
    table.add_row("laps", f"{laps:.2f}" + (f" ({', '.join(lap_s[:6])})" if lap_s else ""))
    table.add_row("simulated", f"{seconds:.1f} s")
    table.add_row("took", f"{wall_s:.1f} s, {seconds / wall_s:.1f} times real time")
    table.add_row("drawn by", f"the {renderer} renderer")
    table.add_row("off centre", f"{cte.mean():.2f} m on average, {cte.max():.2f} m at most")
    if off_road := sum(driven.off_road for driven in all_driven):
        table.add_row(
            "off the road", f"{counted(off_road, 'row')}, from which a network learns to leave it"
        )
    table.add_row("steering", f"-1 {histogram(steering)} 1")
    console.print(table)


def print_last_lines(folder: Path, off_road: int = 0) -> None:
    """Print the recording's log, and the command to type next.

    Args:
        folder: recording.
        off_road: number of rows off the road; the editor deletes them before a first training.
    """
    here = Path.cwd()
    root = folder.relative_to(here) if folder.is_relative_to(here) else folder
    following = ("edit", root) if off_road else (*FIRST_TRY, f"data.root={root}")
    print_written([folder / LOG_NAME], following)


def histogram(steering: np.ndarray) -> str:
    """Return a text histogram of steering, -1..1 in `BINS` bins.

    Heights are logarithmic, because most recorded steering is close to 0.
    """
    counts, _ = np.histogram(np.clip(steering, -1, 1), BINS, (-1, 1))
    heights = np.log1p(counts) / np.log1p(max(counts.max(), 1))
    return "".join(BARS[int(np.ceil(height * (len(BARS) - 1)))] for height in heights)


def record(
    world: World,
    driver: Expert | HumanControl,
    recorder: Recorder | ParallelRecorder,
    laps: float,
    progress: Callable[[float], None] = lambda metres: None,
    row_s: float = 0.0,
) -> Driven:
    """Drive and record laps in a world that was just reset.

    Args:
        world: world with a renderer.
        driver: driver that gives a command for each frame of the world.
        recorder: recorder of the rows.
        laps: number of laps, fractions included.
        progress: function called with the metres driven after each frame.
        row_s: simulated seconds between rows; every frame is a row where this is less.

    Raises:
        InputError: the driver left the road or got stuck, or the disk is full.
    """
    driven = Driven(world.track.length)
    farthest = farthest_s = 0.0
    recorder.begin_pass()
    while not world.is_complete(laps):
        command = driver(world)
        # Rounded as in World.step, so that at equal rates each frame is a row.
        is_row = world.steps >= round(driven.frames * row_s / PHYSICS_STEP_S)
        if is_row and driver.recording:
            frames = {camera: world.frame(camera) for camera in CAMERAS}
            driven.add_row(recorder, world, frames, command, world.time)
        world.step(*command)
        driven.frames += is_row
        if world.travelled > farthest + 1:
            farthest, farthest_s = world.travelled, world.time
        if world.off_road or world.time - farthest_s > STUCK_S:
            what = f"left the road, {world.cte:+.1f} m" if world.off_road else "got stuck"
            raise InputError(
                f"the driver {what} at {world.place.distance:.0f} m of {world.track.name}; the "
                f"first {recorder.rows} rows are kept in {recorder.folder}; try another seed= or "
                "a lower speed="
            )
        driven.note_lap(world)
        progress(world.travelled)
    driven.metres, driven.seconds = world.travelled, world.time
    return driven


def record_laps(
    passes: RecordOptions | Sequence[RecordOptions], console: Console | None = None
) -> Path:
    """Record one or more passes into the first one's folder, and return that folder.

    >>> clean = RecordOptions(out="laps", laps=1)
    >>> folder = record_laps([clean, replace(clean, noise=0.6, seed=1)])  # doctest: +SKIP

    Raises:
        InputError: an option is wrong, the folder cannot be written, or the driver failed.
    """
    console = console or Console()
    all_options = [passes] if isinstance(passes, RecordOptions) else list(passes)
    for options in all_options:
        options.check()
    runs = [
        replace(options, direction=way)
        for options in all_options
        for way in ((1, -1) if options.direction == "both" else (options.direction,))
    ]
    began, first = time.perf_counter(), all_options[0]
    # Opened before the folder is created, so that a wrong option leaves no folder.
    world, driver = _open(runs[0], first.jobs)
    with (
        Recorder(first.out, first.header, first.relative) as recorder,
        Progress(console=console, transient=True, disable=not console.is_terminal) as progress,
        # At its end it draws and waits for images.
        nullcontext(recorder)
        if first.jobs == 1
        else ParallelRecorder(recorder, first.jobs, progress) as rows,
    ):
        all_driven = []
        for number, options in enumerate(runs):
            if number:
                world, driver = _open(options, first.jobs)
            name = options.track if options.direction == 1 else f"{options.track}, backward"
            task = progress.add_task(name, total=world.drive_m(options.laps))

            def show(metres: float, task: TaskID = task) -> None:
                progress.update(task, completed=metres)

            row_s = 1 / options.frame_rate
            all_driven.append(record(world, driver, rows, options.laps, show, row_s))
            world.drawing().close()
    recipe = {"passes": [{"track": options.track, "laps": options.laps} for options in all_options]}
    with file_errors(path := recorder.folder / RECIPE, "cannot be written ({})"):
        path.unlink(missing_ok=True)  # of a recording that was deleted
        write_new(path, json_text(recipe).encode())
    print_report(console, recorder, all_driven, time.perf_counter() - began, world.drawing().name)
    return recorder.folder


def _open(options: RecordOptions, jobs: int) -> tuple[World, Expert | HumanControl]:
    """Open the world and the driver of a pass; with several jobs, a world that draws nothing."""
    is_person, requests = options.control in REACTION_S, None
    if jobs > 1:
        requests = Requests(options.track, options.renderer, options.quality)
    frame_rate = 1 / PHYSICS_STEP_S if is_person else options.frame_rate
    world = options.open(requests, frame_rate=frame_rate)
    reaction_s = REACTION_S.get(options.control, 0.0)
    settings = ExpertSettings(
        options.speed, noise=options.noise, reaction_s=reaction_s, seed=options.seed
    )
    expert = Expert(world.track, settings)
    return world, HumanControl(options.control, expert, options.seed) if is_person else expert
