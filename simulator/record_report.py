"""What a recording has come to, for a person."""

import shlex
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from simulator.recorder import Recorder

FIRST_TRY = ("python", "-m", "zoo", "experiment=first_try")  # benchmarks/first_try.py
BARS = " ▁▂▃▄▅▆▇█"
BINS = 41


@dataclass
class Driven:
    """What was driven: `cte` (metres) and `steering` of the rows recorded, the track's length in
    metres, seconds of simulated time in all and of every whole lap."""

    length: float
    metres: float = 0.0
    seconds: float = 0.0
    frames: int = 0
    lap_s: list[float] = field(default_factory=list)
    cte: list[float] = field(default_factory=list)
    steering: list[float] = field(default_factory=list)


def print_report(
    console: Console,
    recorder: Recorder,
    all_driven: list[Driven],
    wall_s: float,
    renderer: str,
) -> None:
    """One table: rows, laps, times, how far from the centreline, and how much it steered."""
    cte = np.abs(np.concatenate([one.cte for one in all_driven]))
    steering = np.concatenate([one.steering for one in all_driven])
    seconds = sum(one.seconds for one in all_driven)
    laps = sum(one.metres / one.length for one in all_driven)
    lap_s = [f"{one:.1f} s" for driven in all_driven for one in driven.lap_s]
    frames = sum(one.frames for one in all_driven)
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_row("rows", f"{recorder.rows:,} ({recorder.rows / frames:.0%} of the frames)")
    table.add_row("images", f"{3 * recorder.rows:,}")
    table.add_row("laps", f"{laps:.2f}" + (f" ({', '.join(lap_s[:6])})" if lap_s else ""))
    table.add_row("simulated", f"{seconds:.1f} s")
    table.add_row("took", f"{wall_s:.1f} s, {seconds / wall_s:.1f} times real time")
    table.add_row("drawn by", f"the {renderer} renderer")
    table.add_row("off centre", f"{cte.mean():.2f} m on average, {cte.max():.2f} m at most")
    table.add_row("steering", f"-1 {histogram(steering)} 1")
    console.print(table)


def print_written(path: Path, following: str) -> None:
    """Print the recording's log, and the command to type next."""
    for line in (f"wrote: {path}", f"next: {following}"):
        Console(soft_wrap=True).print(line, highlight=False, markup=False, emoji=False)


def train_command(folder: str | Path) -> str:
    """Return the command that trains on a recording for the first time, as a shell takes it."""
    return shlex.join([*FIRST_TRY, f"data.root={folder}"])


def histogram(steering: np.ndarray) -> str:
    """Bars of how often which steering, -1..1 in `BINS` bins, was recorded; their height is
    logarithmic, since nearly all driving is nearly straight."""
    counts, _ = np.histogram(np.clip(steering, -1, 1), BINS, (-1, 1))
    heights = np.log1p(counts) / np.log1p(max(counts.max(), 1))
    return "".join(BARS[int(np.ceil(height * (len(BARS) - 1)))] for height in heights)
