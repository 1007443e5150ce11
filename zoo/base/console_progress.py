"""Progress of work that takes seconds, on a terminal, in a notebook or in a log file."""

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from zoo.base.process_ranks import is_first_process
from zoo.base.terminal import is_quiet

if TYPE_CHECKING:
    from rich.console import Console

LINE_EVERY_S = 10.0  # in a log file, which has no bar
NOTEBOOK_EVERY_S = 1.0
NOTEBOOK_WIDTH = 79  # characters of the line that changes
KNOWN = 0.01  # share of the work from which the time left is estimated
PYTHONS_OWN = 1000  # Python 3.12 itself freezes 375 objects; a program that freezes has thousands


@contextmanager
def loading(what: str = "loading PyTorch") -> Iterator[None]:
    """Pause garbage collection while slow imports run; show a spinner if stderr is a terminal."""
    with _collection_paused():
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
    """Show progress: a bar on a terminal, one line in a notebook, a line every 10 s elsewhere.

    Yield a function that takes the finished share of the work, 0..1. It is cheap enough for every
    frame of a drive, because a separate thread draws the bar.
    """
    if is_quiet():
        yield lambda share: None
        return
    if console.is_terminal:
        from rich.markup import escape
        from rich.progress import Progress, SpinnerColumn, TimeElapsedColumn

        columns = SpinnerColumn(), *Progress.get_default_columns(), TimeElapsedColumn()
        with Progress(*columns, console=console, transient=True) as progress:
            task = progress.add_task(escape(what), total=1.0)
            yield lambda share: progress.update(task, completed=share)
        return
    began = started = time.monotonic()
    every_s = NOTEBOOK_EVERY_S if console.is_jupyter else LINE_EVERY_S
    next_line = began + every_s

    def show_text(text: str) -> None:
        if console.is_jupyter:  # where rich would add an output for each text
            console.file.write(f"\r{text:<{NOTEBOOK_WIDTH}}")
            console.file.flush()
        else:
            console.print(text, highlight=False, markup=False)

    def print_line(share: float) -> None:
        nonlocal next_line, started
        now = time.monotonic()
        if not share:  # processes start, which says nothing of the pace
            started = now
        if now < next_line:
            return
        next_line = now + every_s
        left = f", {(now - started) * (1 - share) / share:.0f} s left" if share >= KNOWN else ""
        show_text(f"{what}: {share:.0%} after {now - began:.0f} s{left}")

    try:
        yield print_line
    finally:
        if console.is_jupyter:
            show_text("")
            console.file.write("\r")


@contextmanager
def _collection_paused() -> Iterator[None]:
    """Create objects without garbage collections, and count them as old at the end.

    PyTorch and Lightning create 650,000 objects, which Python's collections look through again and
    again: `python -c "import torch, lightning"` takes a fifth less time without them.
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() < PYTHONS_OWN:  # what the process has frozen stays frozen
            gc.freeze()  # sets all objects aside, without a look at them
            gc.unfreeze()  # puts them among the old ones
        gc.enable()
