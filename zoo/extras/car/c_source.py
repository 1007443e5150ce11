"""The text of a C file: its parts, constant arrays, and the statements of its function."""

import re
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from zoo.base.errors import UsageError

C_WIDTH = 97  # of a comment
_NOT_IN_C = re.compile(r"[^ -)+->@-\[\]-~]")  # all but printable ASCII without *, ? and \
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,50}", re.ASCII)
# Words that C or the file uses, in any case: a header defines NAME_WIDTH, a file FRAME_WIDTH.
TAKEN = re.compile(
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|"
    "inline|int|long|main|register|restrict|return|short|signed|sizeof|static|struct|switch|"
    "typedef|union|unsigned|void|volatile|while|work|window|weight|view|sample|store|convert|"
    "under|difference|mirrored|nearest|exponential|convolve|pool_max|pool_mean|copy|clipped|"
    "throttle|not_a_number|frame|rgb|width|height|speed_mph|cropped|red|green|blue|top|channels|"
    r"sampled|lanes|half_up|area_scale|(frame|view|cropped)_(width|height)|u?int\d+_t|"
    r"(row|column)_(at|start|weight)|(weights|bias|scale|window)_\d+|"
    # Of the language and of the header that the file includes.
    r"_.*|asm|bool|true|false|null|u?int\w+_(c|min|max)",
    re.IGNORECASE,
)
TYPES = "type "  # beginning of the names of parts that stand before the arrays


def function_name(path: Path) -> str:
    """Return the name of the function in a C file, which is the file's.

    Raises:
        UsageError: C allows no function of that name.
    """
    if not _NAME.fullmatch(path.stem) or TAKEN.fullmatch(path.stem):
        raise UsageError(
            f"out={path}: the function would be {path.stem}(), a name that C or the file uses; "
            "name a file such as steer.c"
        )
    return path.stem


@cache
def read_parts() -> dict[str, str]:
    """Return the parts that are the same for every network, by name."""
    text = Path(__file__).with_name("static").joinpath("parts.c").read_text(encoding="utf-8")
    _, *pieces = re.split(r"/\* part: (.*) \*/\n", text)
    return dict(zip(pieces[::2], (text.strip() for text in pieces[1::2]), strict=True))


@dataclass
class CSource:
    """A C file that is being written.

    Attributes:
        constants: integers, by name.
        definitions: floats that are macros, by name.
        tables: definitions of constant arrays.
        parts: names of the needed parts, in order.
        calls: statements of the function.
        floats: length of the array `work`.
    """

    constants: dict[str, int] = field(default_factory=dict)
    definitions: dict[str, float] = field(default_factory=dict)
    tables: list[str] = field(default_factory=list)
    parts: dict[str, None] = field(default_factory=dict)
    calls: list[str] = field(default_factory=list)
    floats: int = 0

    def need(self, *names: str) -> None:
        """Add parts, once each."""
        self.parts |= dict.fromkeys(names)

    def table(self, name: str, kind: str, values: Iterable[float]) -> str:
        """Add a constant array; return its name."""
        numbers = [c_number(value) if kind == "float" else str(int(value)) for value in values]
        lines = (", ".join(numbers[start : start + 8]) for start in range(0, len(numbers), 8))
        body = ",\n    ".join(lines)
        self.tables.append(f"static const {kind} {name}[{len(numbers)}] = {{\n    {body}\n}};")
        return name

    def text(self, head: str, function: str) -> str:
        """Return the whole file.

        Args:
            head: its first lines.
            function: functions that other files call.
        """
        parts = read_parts()
        types = [parts[part] for part in self.parts if part.startswith(TYPES)]
        others = [parts[part] for part in self.parts if not part.startswith(TYPES)]
        values = [f"    {name} = {value}" for name, value in self.constants.items()]
        enum = "enum {\n" + ",\n".join(values) + "\n};"
        macros = [f"#define {name} {c_number(value)}" for name, value in self.definitions.items()]
        memory = f"/* The values between the layers. */\nstatic float work[{self.floats}];"
        sections = [head, enum, *macros, *types, *self.tables, memory, *others, function]
        return "\n\n".join(sections) + "\n"


def c_number(value: float) -> str:
    """Return a float as C writes it, with the digits that give it back to the bit.

    >>> c_number(0.1), c_number(-2)
    ('0.1f', '-2.0f')
    """
    return f"{np.float32(value)!s}f"


def c_comment(text: str) -> str:
    r"""Return a text of several lines as lines of a C comment, which it cannot end.

    >>> c_comment("a */ b")
    ' * a _/ b'
    """
    lines = []
    for line in (_NOT_IN_C.sub("_", row) for row in text.replace("\\", "").splitlines()):
        is_whole = line.startswith(("drivezoo ", "|"))  # a command, or a row of a table
        lines += (
            [line] if is_whole else textwrap.wrap(line, C_WIDTH, subsequent_indent="  ") or [""]
        )
    return "\n".join(f" * {line}".rstrip() for line in lines)
