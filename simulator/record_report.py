"""The report printed at the end of a recording."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from simulator.recorder import Recorder
from zoo.base.terminal import command_line

FIRST_TRY = ("drivezoo", "train", "experiment=first_try")  # docs/recipes.md
BARS = " ▁▂▃▄▅▆▇█"
BINS = 41


@dataclass
class Driven:
    """Figures of one pass.

    Attributes:
        length: length of the track in metres.
        metres: metres driven along the lap.
        seconds: simulated seconds driven.
        frames: frames driven, recorded or not.
        lap_s: simulated seconds of each whole lap.
        cte: cross-track error of each recorded row in metres.
        steering: steering of each recorded row, -1..1.
        off_road: number of recorded rows in which the car was off the road.
    """

    length: float
    metres: float = 0.0
    seconds: float = 0.0
    frames: int = 0
    lap_s: list[float] = field(default_factory=list)
    cte: list[float] = field(default_factory=list)
    steering: list[float] = field(default_factory=list)
    off_road: int = 0


def print_report(
    console: Console,
    recorder: Recorder,
    all_driven: list[Driven],
    wall_s: float,
    renderer: str,
) -> None:
    """Print a table of rows, laps, times, cross-track error and steering."""
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
    if off_road := sum(one.off_road for one in all_driven):
        table.add_row("off the road", f"{off_road:,} rows, from which a network learns to leave it")
    table.add_row("steering", f"-1 {histogram(steering)} 1")
    console.print(table)


def print_written(path: Path, following: str) -> None:
    """Print the recording's log, and the command to type next."""
    for line in (f"wrote: {path}", f"next: {following}"):
        Console(soft_wrap=True).print(line, highlight=False, markup=False, emoji=False)


def next_command(folder: str | Path, off_road: int = 0) -> str:
    """Return the shell command to type after a recording.

    Args:
        folder: recording.
        off_road: number of rows off the road; the editor deletes them before a first training.
    """
    if off_road:
        return command_line(["drivezoo", "edit", str(folder)])
    return command_line([*FIRST_TRY, f"data.root={folder}"])


def histogram(steering: np.ndarray) -> str:
    """Return a text histogram of steering, -1..1 in `BINS` bins.

    Heights are logarithmic, because most recorded steering is close to 0.
    """
    counts, _ = np.histogram(np.clip(steering, -1, 1), BINS, (-1, 1))
    heights = np.log1p(counts) / np.log1p(max(counts.max(), 1))
    return "".join(BARS[int(np.ceil(height * (len(BARS) - 1)))] for height in heights)
