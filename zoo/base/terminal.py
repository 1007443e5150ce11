"""Texts for a terminal: escaped, commands to paste, last lines of a command; how much is shown."""

import os
import re
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.parts import typed_parts

if TYPE_CHECKING:
    from rich.console import Console

# An environment variable keeps the choice, so that processes which a command starts make it, too.
VARIABLE = "DRIVEZOO_VERBOSITY"
FLAGS = {"-q": "quiet", "--quiet": "quiet", "-v": "verbose", "--verbose": "verbose"}
MOST = 4000  # characters of an error's line; the middle of a longer one is left out


def printable(text: str) -> str:
    r"""Return a text with all characters escaped that are not printable.

    >>> print(printable("\x1b[2Jis é\u202e"))
    \x1b[2Jis é\u202e
    """
    if text.isprintable():
        return text
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode() for char in text
    )


def counted(count: float, noun: str, plural: str = "") -> str:
    """Return a number with its noun, which has an s unless the number is 1 or the plural is given.

    >>> counted(1, "thread"), counted(0.5, "lap"), counted(12_000, "row"), counted(2, "is", "are")
    ('1 thread', '0.5 laps', '12,000 rows', '2 are')
    """
    number = f"{count:g}" if isinstance(count, float) else f"{count:,}"
    return f"{number} {noun if count == 1 else plural or f'{noun}s'}"


def command_line(words: Iterable[object]) -> str:
    """Return words as a command that a person can read and paste into any shell.

    The user's `parts=...` are added to a command that takes them; an ONNX file holds its network.

    >>> print(command_line(["drivezoo", "train", "data.root=/a b", "augment=[shift]"]))
    drivezoo train 'data.root=/a b' 'augment=[shift]'
    >>> print(command_line(["drivezoo", "check", "Ann's laps"]))
    drivezoo check "Ann's laps"
    """
    typed = list(map(str, words))
    program, name, first, *_ = [*typed, "", "", ""]
    if program == "drivezoo" and name != "simulator" and not first.endswith(".onnx"):
        typed += typed_parts()
    return " ".join(map(_quoted, typed))


def _quoted(word: str) -> str:
    # Within double quotes, PowerShell runs $(...), and cmd.exe replaces %NAME%, perhaps by a quote.
    if os.name == "nt":
        word = re.sub(r'["`\u201c-\u201e]|\$(?=[({\w])|%(?=[^%]+%)', "?", word)
    # cmd.exe knows no single quotes; PowerShell splits at commas, and bash drops plain backslashes.
    if os.name == "nt" or ("'" in word and not re.search(r'["$`\\!]', word)):
        word = re.sub(r"\\$", r"\\\\", word)  # else it escapes the quote: D:\
        return word if re.fullmatch(r"[\w@%+=:./-]+", word) else f'"{word}"'
    return f"'{word}'" if word.startswith("=") else shlex.quote(word)  # zsh looks up =NAME


def error_line(name: str, error: object) -> str:
    r"""Return the one line that a command prints for an error.

    Args:
        name: command.
        error: exception or text; its line ends become blanks.

    >>> print(error_line("check", "a\x1b[2J:\nno such folder"))
    check: a\x1b[2J: no such folder
    """
    line = printable(" ".join(str(error).split()))
    if len(line) > MOST:
        line = f"{line[: MOST // 2]} ... {line[-MOST // 2 :]}"
    return f"{name}: {line}"


def print_line(console: "Console", line: str) -> None:
    """Print a text as it is: without colours for numbers, and with its square brackets."""
    console.print(line, highlight=False, markup=False, emoji=False)


def guard_rich() -> None:
    """Make rich escape the control characters of all texts that it prints, in any console.

    rich removes five of them from every text by a table, and adds its own control characters
    later. The table has no public name: if a version of rich lacks it, nothing changes.
    """
    try:
        import rich.control
    except ImportError:  # the doctor runs without packages
        return
    table = getattr(rich.control, "_CONTROL_STRIP_TRANSLATE", {})
    marks = (
        "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"  # of direction
    )
    for code in {*range(32), *range(127, 160), *map(ord, marks)} - {*map(ord, "\t\n")}:
        table.setdefault(code, printable(chr(code)))


def take_verbosity(arguments: Sequence[str]) -> list[str]:
    """Return the arguments without `-q` and `-v`, and keep the last of these."""
    for flag in filter(FLAGS.get, arguments):
        os.environ[VARIABLE] = FLAGS[flag]
    return [argument for argument in arguments if argument not in FLAGS]


def is_quiet() -> bool:
    """Return whether progress and hints are left out."""
    return os.environ.get(VARIABLE) == "quiet"


def is_verbose() -> bool:
    """Return whether a sweep prints each job's output, and an error its traceback."""
    return os.environ.get(VARIABLE) == "verbose"


def shown_path(path: str | Path) -> str:
    """Return a path as a user types it: relative if it lies below the current folder.

    >>> shown_path(Path.cwd() / "outputs" / "run"), shown_path("run"), shown_path("https://a/b")
    ('outputs/run', 'run', 'https://a/b')
    """
    is_below = Path(path).is_absolute() and Path(path).is_relative_to(Path.cwd())
    return str(Path(path).relative_to(Path.cwd())) if is_below else str(path)


def print_written(
    written: Iterable[str | Path],
    following: Iterable[object] = (),
    console: "Console | None" = None,
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
        _print(f"wrote: {shown_path(path)}", console)
    words = [shown_path(str(word)) for word in following]
    if words:
        print_next(command_line(["drivezoo", *words]), console=console)


def print_next(command: str, purpose: str = "", console: "Console | None" = None) -> None:
    """Print `next: COMMAND` and the purpose below it; in zsh a `#` begins no comment.

    With `-q` nothing is printed.
    """
    if is_quiet():
        return
    _print(f"next: {command}", console)
    if purpose:
        _print(f"      {purpose}", console)


def _print(line: str, console: "Console | None") -> None:
    if console is None:
        print(printable(line))
    else:
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
