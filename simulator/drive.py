"""The command `python -m simulator drive track=lake`: drive and record in a window."""

import datetime
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console

from simulator.command_line import read_options
from simulator.drive_loop import Drive
from simulator.drive_screen import HELP, DriveScreen
from simulator.errors import SimulatorError
from simulator.record_report import print_report, train_command
from simulator.recorder import LOG_NAME, Recorder, check_free
from simulator.rig import PHYSICS_STEP_S
from simulator.weather import read_weather
from simulator.window import Window
from simulator.world import Start, World, open_world

DIRECTIONS = {"forward": 1, "1": 1, "backward": -1, "-1": -1}


@dataclass(frozen=True)
class DriveOptions:
    """Drive in a window, with keyboard, mouse or gamepad; R starts and stops recording.

    Args:
        track: name of a track, or path of its YAML file.
        out: folder of the recording; auto is recordings/ and the time of its start.
        direction: forward or backward.
        weather: clear, random (drawn from the seed), or settings such as {fog: 0.4, wet: 1}.
        seed: random seed of the weather.
        start: start position in metres along the lap.
        frame_rate: rows per second of simulated time, up to 50.
        width: width of the window in pixels, 320..7680; its height is half of that.
        renderer: renderer of the recorded images: auto, software or opengl.
        header: whether the log begins with column names, as the course's sample data does.
        relative: whether the log has paths relative to its folder (IMG/...).
        seconds: seconds of driving until the end; 0 for no end.
    """

    track: str = "lake"
    out: str = "auto"
    direction: str = "forward"
    weather: str = "clear"
    seed: int = 0
    start: float = 0.0
    frame_rate: float = 15.0
    width: int = 1280
    renderer: str = "auto"
    header: bool = False
    relative: bool = False
    seconds: float = 0.0


def drive(options: DriveOptions, console: Console | None = None) -> Path | None:
    """Let a person drive in a window; return the recording's folder, or None without rows.

    Raises:
        SimulatorError: an option is wrong, no window opens, or the recording cannot be written.
    """
    console = console or Console(soft_wrap=True)
    world = _open(options)
    title = f"{world.track.name}, python -m simulator drive"
    window = Window(title, (options.width, options.width // 2))
    screen = DriveScreen(window, world.pictures, world.weather)
    run = Drive(world, screen, partial(_open_recorder, options), options.frame_rate)
    console.print(HELP.replace("     ", "\n"), highlight=False, markup=False)
    began = time.perf_counter()
    try:
        with ExitStack() as recorders:
            run.run(recorders, options.seconds)
    finally:
        window.close()
    if run.recorder is None or not run.recorder.rows:
        console.print("nothing was recorded; press R while driving to record")
        return None
    took = time.perf_counter() - began
    print_report(console, run.recorder, [run.driven], took, world.pictures.name)
    return run.recorder.folder


def main(arguments: Sequence[str]) -> None:
    """Run the command with `key=value` arguments; see `DriveOptions`."""
    folder = drive(read_options(DriveOptions, arguments))
    if folder is None:
        return
    here = Path.cwd()
    root = folder.relative_to(here) if folder.is_relative_to(here) else folder
    for line in (str(folder / LOG_NAME), f"train on it: {train_command(root)}"):
        Console(soft_wrap=True).print(line, highlight=False, markup=False)


def _open(options: DriveOptions) -> World:
    if options.direction not in DIRECTIONS:
        raise SimulatorError(f"direction={options.direction}: must be forward or backward")
    read_weather(options.weather)  # raises for wrong weather before anything is opened
    if options.renderer == "none":
        raise SimulatorError("renderer=none: a recording needs images; use renderer=auto")
    if not 0 < options.frame_rate <= 1 / PHYSICS_STEP_S:
        raise SimulatorError(f"frame_rate={options.frame_rate:g}: must be above 0, up to 50")
    if not 320 <= options.width <= 7680:
        raise SimulatorError(f"width={options.width}: must be in 320..7680 pixels")
    if not 0 <= options.seconds < float("inf"):
        raise SimulatorError(f"seconds={options.seconds:g}: must be 0 or more")
    check_free(_folder(options.out))
    world = open_world(
        options.track,
        options.renderer,
        frame_rate=1 / PHYSICS_STEP_S,
        direction=DIRECTIONS[options.direction],
    )
    world.reset(options.seed, Start(options.start), read_weather(options.weather))
    return world


def _open_recorder(options: DriveOptions) -> Recorder:
    return Recorder(_folder(options.out), options.header, options.relative)


def _folder(out: str) -> Path:
    """Return the folder `out`; for `auto`, one named after the present time."""
    moment = datetime.datetime.now()
    return Path("recordings", f"{moment:%Y-%m-%d_%H-%M-%S}") if out == "auto" else Path(out)
