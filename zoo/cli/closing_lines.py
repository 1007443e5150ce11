"""Last lines of a command's output: the files that it wrote, and the next command."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.parts import typed_parts
from zoo.base.terminal import command_line, is_quiet, printable

if TYPE_CHECKING:
    from rich.console import Console


def print_written(
    written: Iterable[str | Path], following: Iterable[object] = (), console: Console | None = None
) -> None:
    """Print `wrote: PATH` for each path, then `next: drivezoo ...`.

    >>> print_written(["my run/film.mp4"], ["report", "my run"])
    wrote: my run/film.mp4
    next: drivezoo report 'my run'

    Args:
        written: paths of the files and folders that the command wrote.
        following: words of the next command after `drivezoo`; empty for no `next:` line.
        console: console to print on; None for standard output.
    """
    for path in written:
        _print(f"wrote: {path}", console)
    words = [str(one) for one in following]
    if words:
        print_next(command_line(["drivezoo", *words]), console=console)


def print_next(command: str, purpose: str = "", console: Console | None = None) -> None:
    """Print `next: COMMAND  # PURPOSE`; the text after `next:` can be pasted into a shell.

    The user's `parts=...` are added to a command that takes them. With `-q` nothing is printed.
    """
    if is_quiet():
        return
    program, name, *_ = [*command.split(), ""]
    if program == "drivezoo" and name not in ("check", "simulator"):
        command = f"{command} {command_line(typed_parts())}".rstrip()
    _print(f"next: {command}{f'  # {purpose}' if purpose else ''}", console)


def _print(line: str, console: Console | None) -> None:
    if console is None:
        print(printable(line))
    else:
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
