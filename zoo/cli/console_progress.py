"""Progress of work that takes seconds, on a terminal or in a log file."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from zoo.cli.paused_collection import collection_paused
from zoo.cli.process_ranks import is_first_process
from zoo.cli.verbosity import is_quiet

if TYPE_CHECKING:
    from rich.console import Console

LINE_EVERY_S = 10.0  # in a log file, which has no bar
KNOWN = 0.01  # share of the work from which the time left is estimated
DRAW_EVERY_S = 0.1


@contextmanager
def loading(what: str = "loading PyTorch") -> Iterator[None]:
    """Pause garbage collection while slow imports run; show a spinner if stderr is a terminal."""
    with collection_paused():
        if not sys.stderr.isatty() or not is_first_process() or is_quiet():
            yield
            return
        from rich.console import Console

        with working(what, Console(stderr=True)):
            yield


@contextmanager
def working(what: str, console: "Console") -> Iterator[None]:
    """Show a spinner with the elapsed time on a terminal, and erase it at the end."""
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal or is_quiet()
    ) as progress:
        progress.add_task(what, total=None)
        yield


@contextmanager
def progress_bar(what: str, console: "Console") -> Iterator[Callable[[float], None]]:
    """Show progress: a bar on a terminal, a line every 10 s elsewhere.

    Yield a function that takes the finished share of the work, 0..1. It is cheap enough for every
    frame of a drive, because a separate thread draws the bar.
    """
    if is_quiet():
        yield lambda share: None
        return
    began = time.monotonic()
    if not console.is_terminal:
        next_line = began + LINE_EVERY_S

        def print_line(share: float) -> None:
            nonlocal next_line
            now = time.monotonic()
            if now < next_line:
                return
            next_line = now + LINE_EVERY_S
            left = f", {(now - began) * (1 - share) / share:.0f} s left" if share >= KNOWN else ""
            text = f"{what}: {share:.0%} after {now - began:.0f} s{left}"
            console.print(text, highlight=False, markup=False)

        yield print_line
        return
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(what, total=1.0)
        next_draw = 0.0

        def draw(share: float) -> None:
            nonlocal next_draw
            now = time.monotonic()
            if now >= next_draw:
                next_draw = now + DRAW_EVERY_S
                progress.update(task, completed=share)

        yield draw
