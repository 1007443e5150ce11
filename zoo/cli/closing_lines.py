"""The lines that end a command: what it wrote, and what to type next."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from datamodules.terminal import printable

if TYPE_CHECKING:
    from rich.console import Console


def print_written(
    written: Iterable[str | Path], following: Iterable[object] = (), console: Console | None = None
) -> None:
    """Print `wrote: PATH` for each path, then `next: python -m zoo...`.

    >>> print_written(["my run/film.mp4"], ["zoo.report", "my run"])
    wrote: my run/film.mp4
    next: python -m zoo.report 'my run'

    Args:
        written: files and folders that the command wrote; none for a command that only prints.
        following: words of the next command after `python -m`; none prints no such line.
        console: where the command prints; None is standard output.
    """
    for path in written:
        _print(f"wrote: {path}", console)
    words = [str(one) for one in following]
    if words:
        print_next(shlex.join(["python", "-m", *words]), console=console)


def print_next(command: str, purpose: str = "", console: Console | None = None) -> None:
    """Print `next: COMMAND  # PURPOSE`, which a shell takes as it stands."""
    _print(f"next: {command}{f'  # {purpose}' if purpose else ''}", console)


def _print(line: str, console: Console | None) -> None:
    if console is None:
        print(printable(line))
    else:
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
