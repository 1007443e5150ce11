"""The command `drivezoo simulator drive track=lake`: drive and record in a window."""

import datetime
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from rich.console import Console

from simulator.drive_loop import Drive
from simulator.drive_options import DriveOptions
from simulator.drive_screen import HELP, DriveScreen
from simulator.record_report import print_report
from simulator.recorder import Recorder, check_free
from simulator.rig import PHYSICS_STEP_S
from simulator.weather import read_weather
from simulator.window import Window
from simulator.world import Start, World, open_world
from zoo.base.errors import InputError


def drive(options: DriveOptions, console: Console | None = None) -> tuple[Path, int] | None:
    """Let a person drive in a window.

    Returns:
        The recording's folder and its number of rows off the road; None without rows.

    Raises:
        InputError: an option is wrong, no window opens, or the recording cannot be written.
    """
    console = console or Console(soft_wrap=True)
    world = _open(options)
    title = f"{world.track.name}, drivezoo simulator drive"
    window = Window(title, (options.width, options.width // 2))
    screen = DriveScreen(window, world.renderer, world.weather)
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
    print_report(console, run.recorder, [run.driven], took, world.renderer.name)
    return run.recorder.folder, run.driven.off_road


def _open(options: DriveOptions) -> World:
    options.check()
    if options.renderer == "none":
        raise InputError("renderer=none: a recording needs images; use renderer=auto")
    if not 320 <= options.width <= 7680:
        raise InputError(f"width={options.width}: must be in 320..7680 pixels")
    if not 0 <= options.seconds < float("inf"):
        raise InputError(f"seconds={options.seconds:g}: must be 0 or more")
    check_free(_folder(options.out))
    place = options.place | {"frame_rate": 1 / PHYSICS_STEP_S}
    world = open_world(renderer=options.renderer, **place)
    world.reset(options.seed, Start(options.start), read_weather(options.weather))
    return world


def _open_recorder(options: DriveOptions) -> Recorder:
    return Recorder(_folder(options.out), options.header, options.relative)


def _folder(out: str) -> Path:
    """Return the folder `out`; for `auto`, one named after the present time."""
    moment = datetime.datetime.now()
    return Path("recordings", f"{moment:%Y-%m-%d_%H-%M-%S}") if out == "auto" else Path(out)
