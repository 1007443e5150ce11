"""Progress of work that takes seconds, on a terminal, in a notebook or in a log file."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING

from zoo.base.verbosity import is_quiet
from zoo.cli.paused_collection import collection_paused
from zoo.cli.process_ranks import is_first_process

if TYPE_CHECKING:
    from rich.console import Console

LINE_EVERY_S = 10.0  # in a log file, which has no bar
NOTEBOOK_EVERY_S = 1.0
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


class ChangingLine:
    """A line whose text is replaced, for a notebook: rich would add an output for each text."""

    def __init__(self, file: IO[str]) -> None:
        self.file, self.width = file, 0

    def show(self, text: str) -> None:
        """Replace the line's text."""
        self.file.write(f"\r{text:<{self.width}}")
        self.file.flush()
        self.width = len(text)

    def erase(self) -> None:
        """Erase the text, if there is one; the next output begins in its place."""
        if self.width:
            self.show("")
            self.file.write("\r")


@contextmanager
def progress_bar(what: str, console: "Console") -> Iterator[Callable[[float], None]]:
    """Show progress: a bar on a terminal, one line in a notebook, a line every 10 s elsewhere.

    Yield a function that takes the finished share of the work, 0..1. It is cheap enough for every
    frame of a drive, because a separate thread draws the bar.
    """
    if is_quiet():
        yield lambda share: None
        return
    began = time.monotonic()
    if not console.is_terminal:
        every_s = NOTEBOOK_EVERY_S if console.is_jupyter else LINE_EVERY_S
        next_line = began + every_s
        line = ChangingLine(console.file)

        def print_line(share: float) -> None:
            nonlocal next_line
            now = time.monotonic()
            if now < next_line:
                return
            next_line = now + every_s
            left = f", {(now - began) * (1 - share) / share:.0f} s left" if share >= KNOWN else ""
            text = f"{what}: {share:.0%} after {now - began:.0f} s{left}"
            if console.is_jupyter:
                line.show(text)
            else:
                console.print(text, highlight=False, markup=False)

        try:
            yield print_line
        finally:
            line.erase()
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
