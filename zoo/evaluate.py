"""`python -m zoo.evaluate CKPT [track=lake,mountain laps=1 seeds=3]`: score a checkpoint by driving.

Drives it in the embedded world, several drives in parallel, without a simulator or a display.
"""

import datetime
import json
import multiprocessing
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track as show_progress
from rich.table import Table

from datamodules.errors import InputError
from zoo.command_line import run_command

USAGE = "name a checkpoint: python -m zoo.evaluate RUN_FOLDER/checkpoints/best.ckpt track=lake"


@dataclass(frozen=True)
class EvaluateOptions:
    """How a checkpoint is scored.

    Args:
        track: names or files, with commas between.
        laps: driven in each drive.
        seeds: so many drives on each track; seed 0 starts at the track's first point.
        speed: miles per hour to hold, by the course's PI controller.
        margin: metres off the centreline that count as an intervention; null for the edge line.
        weather: clear, or random for a day drawn from each seed.
        direction: 1, or -1 for the other way round.
        frame_rate: frames per second of simulated time.
        delay_s: from a command to the wheels.
        quality: full, or simple pictures.
        out: the folder for figures and pictures; null names one by date and time.
        workers: processes; 0 takes one a core.
    """

    track: str = "lake"
    laps: float = 1.0
    seeds: int = 1
    speed: float = 15.0
    margin: float | None = None
    weather: str = "clear"
    direction: int = 1
    frame_rate: float = 15.0
    delay_s: float = 0.0
    quality: str = "full"
    out: str | None = None
    workers: int = 0


def evaluate(checkpoint: str, options: EvaluateOptions, console: Console) -> dict:
    """Drive, print the table, and write `metrics.json`, drives and plots; returns the metrics.

    Raises:
        InputError: no such checkpoint or track, an option that cannot be.
    """
    from zoo.checkpoint import load_checkpoint

    load_checkpoint(checkpoint)  # what is wrong with it is said before processes start
    _check(options)
    jobs = [(name, seed) for name in options.track.split(",") for seed in range(options.seeds)]
    folder = _new_folder(options)
    processes = min(options.workers or os.cpu_count() or 1, len(jobs))
    found: dict[tuple[str, int], dict] = {}
    # Spawned: PyTorch's and Panda3D's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        waiting = {
            pool.submit(drive_once, checkpoint, options, name, seed, str(folder)): (name, seed)
            for name, seed in jobs
        }
        for done in show_progress(
            as_completed(waiting),
            f"driving {len(jobs)} x {options.laps:g} laps",
            total=len(jobs),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        ):
            found[waiting[done]] = done.result()
    drives = [found[job] for job in jobs]
    metrics = {
        "checkpoint": str(checkpoint),
        "drives": drives,
        "tracks": {
            name: _mean_and_spread([one for one in drives if one["track"] == name])
            for name in dict.fromkeys(one["track"] for one in drives)
        },
    }
    (folder / "metrics.json").write_text(json.dumps(metrics, indent=1) + "\n")
    _print_table(metrics["tracks"], console)
    console.print(str(folder), highlight=False, markup=False, soft_wrap=True)
    return metrics


def drive_once(
    checkpoint: str, options: EvaluateOptions, name: str, seed: int, folder: str
) -> dict[str, float | str | int]:
    """One drive in this process: its figures; the drive and its plots are left in `folder`."""
    import torch

    from simulator.world import open_world
    from zoo.driving.drive_log import DriveWriter, write_summary
    from zoo.driving.speed_controller import PI
    from zoo.plots import save_figure
    from zoo.policy import load_policy
    from zoo.scoring.closed_loop import drive_closed_loop, score
    from zoo.scoring.figures import birds_eye, error_over_distance

    torch.set_num_threads(1)
    world = open_world(
        name, "auto", options.quality, options.frame_rate, options.delay_s, options.direction
    )
    speed = PI(options.speed, kp=0.1, ki=0.002)
    drive = drive_closed_loop(
        load_policy(checkpoint), world, speed, seed, options.laps, options.weather, options.margin
    )
    figures = {"track": world.track.name, "seed": seed, **score(drive)}
    place = Path(folder) / f"{world.track.name}-{seed}"
    writer = DriveWriter(place)
    writer.add(drive.rows)
    writer.close()
    write_summary(place, figures)
    title = (
        f"{world.track.name}, seed {seed}: autonomy {figures['autonomy']:.1%}, "
        f"{figures['interventions']} interventions"
    )
    save_figure(birds_eye(world.track, drive, title), place / "track.png")
    save_figure(error_over_distance(drive, title), place / "error.png")
    return {key: v if v != float("inf") else None for key, v in figures.items()}


def _check(options: EvaluateOptions) -> None:
    """What a process would find out late; opening a world without pictures checks the rest."""
    from simulator.errors import SimulatorError
    from simulator.world import open_world

    if options.seeds < 1 or options.workers < 0 or not 0 < options.laps <= 1000:
        raise InputError("laps and seeds must be above 0, workers 0 or more")
    if options.weather not in ("clear", "random"):
        raise InputError(f"weather={options.weather}: must be clear or random")
    if not 1 <= options.speed <= 30:
        raise InputError(f"speed={options.speed:g}: must be in 1..30 mph")
    if options.margin is not None and options.margin <= 0:
        raise InputError(f"margin={options.margin:g}: must be above 0 metres, or null")
    try:
        for name in options.track.split(","):
            open_world(
                name,
                "none",
                frame_rate=options.frame_rate,
                delay_s=options.delay_s,
                direction=options.direction,
            )
    except SimulatorError as error:
        raise InputError(str(error)) from None


def _new_folder(options: EvaluateOptions) -> Path:
    now = datetime.datetime.now()
    folder = Path(options.out or f"outputs/evaluations/{now:%Y-%m-%d}/{now:%H-%M-%S-%f}")
    if (folder / "metrics.json").exists():
        raise InputError(f"{folder}: holds an evaluation already; name another folder with out=")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _mean_and_spread(drives: list[dict]) -> dict[str, tuple[float, float] | None]:
    """Mean and standard deviation over drives of every figure; None where one is infinite."""
    figures = [key for key in drives[0] if key not in ("track", "seed")]
    columns = {key: [one[key] for one in drives] for key in figures}
    return {
        key: None if None in values else (float(np.mean(values)), float(np.std(values)))
        for key, values in columns.items()
    }


ROWS = {
    "autonomy": ("autonomy", "{:.1%}"),
    "interventions": ("interventions", "{:.1f}"),
    "m_per_intervention": ("metres per intervention", "{:.0f}"),
    "laps": ("laps", "{:.2f}"),
    "lap_s": ("lap time, s", "{:.1f}"),
    "cte_mean_m": ("cross-track error, mean, m", "{:.2f}"),
    "cte_rms_m": ("cross-track error, RMS, m", "{:.2f}"),
    "cte_max_m": ("cross-track error, max, m", "{:.2f}"),
    "beyond_1m": ("time beyond 1 m", "{:.1%}"),
    "steering_per_s": ("steering change, 1/s", "{:.2f}"),
    "speed_mph": ("speed, mph", "{:.1f}"),
    "stalled": ("time stalled", "{:.1%}"),
    "latency_ms": ("latency, median, ms", "{:.1f}"),
}


def _print_table(tracks: dict[str, dict], console: Console) -> None:
    table = Table("driving", *tracks)
    for key, (label, form) in ROWS.items():
        cells = []
        for figures in tracks.values():
            if figures[key] is None:
                cells.append("no intervention")
                continue
            mean, spread = figures[key]
            cells.append(form.format(mean) + (f" ± {form.format(spread)}" if spread else ""))
        table.add_row(label, *cells)
    console.print(table)


def command(arguments: Sequence[str]) -> None:
    """The command: a checkpoint's path, then `key=value` options, see `EvaluateOptions`."""
    from simulator.command_line import read_options
    from simulator.errors import SimulatorError

    if not arguments or arguments[0] in ("-h", "--help"):
        raise InputError(USAGE)
    try:
        options = read_options(EvaluateOptions, arguments[1:])
    except SimulatorError as error:
        raise InputError(str(error)) from None
    evaluate(arguments[0], replace(options), Console())


if __name__ == "__main__":
    sys.exit(run_command("zoo.evaluate", command, sys.argv[1:]))
