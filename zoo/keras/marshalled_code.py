"""Read constants, names and instructions from marshalled Python code, as data.

The bytes are never given to Python's `marshal`, nor run: this reader knows the format of Python 2.7
to 3.14 (CPython's `Python/marshal.c`) and returns numbers, texts and tuples.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

MOST_BYTES = 100_000
MOST_OBJECTS = 10_000
MOST_LEVELS = 20
MOST_DIGITS = 10  # of 15 bits each, of a whole number
# Whole numbers before the code, and objects after it, in Python 2.7, 3.0, 3.8 and 3.11.
LAYOUTS = {"2.7": (4, 8), "3.0": (5, 8), "3.8": (6, 8), "3.11": (5, 9)}
SINGLE = {"N": None, "T": True, "F": False, ".": ..., "0": None, "S": None}


@dataclass(frozen=True)
class Code:
    """A function's code.

    Attributes:
        layout: first Python version with this layout, a key of `LAYOUTS`.
        instructions: bytecode.
        constants: its constants: numbers, texts, tuples, None and inner functions' `Code`.
        names: names of globals, modules and attributes that it uses.
        free: number of variables of an outer function that it uses.
    """

    layout: str
    instructions: bytes
    constants: tuple
    names: tuple
    free: int


def read_code(data: bytes) -> Code | None:
    """Return the code in marshalled bytes; None if they are no code of a known layout."""
    if len(data) > MOST_BYTES:
        return None
    for layout in reversed(LAYOUTS):
        try:
            reader = _Reader(data, layout)
            found = reader.read(0)
        except (ValueError, IndexError, TypeError, struct.error, OverflowError):
            continue
        if isinstance(found, Code) and reader.at == len(data):
            return found
    return None


class _Reader:
    def __init__(self, data: bytes, layout: str) -> None:
        self.data, self.layout, self.at = data, layout, 0
        self.count = 0
        self.shared: list = []  # objects that later ones refer to
        self.counts: dict[int, tuple[int, tuple]] = {}  # values of a tuple, by its `id`
        self.interned: list = []  # of Python 2

    def read(self, depth: int) -> Any:
        """Return the next object; raise ValueError if it is of an unknown kind."""
        self.count += 1
        if depth > MOST_LEVELS or self.count > MOST_OBJECTS:
            raise ValueError("too many objects")
        (mark,) = self._take(1)
        kind = chr(mark & 0x7F)
        if not mark & 0x80:
            return self._value(kind, depth)
        place = len(self.shared)
        self.shared.append(None)
        self.shared[place] = self._value(kind, depth)
        return self.shared[place]

    def _value(self, kind: str, depth: int) -> Any:
        if kind in SINGLE:
            return SINGLE[kind]
        if kind == "i":
            return self._long()
        if kind == "I":
            return struct.unpack("<q", self._take(8))[0]
        if kind == "l":
            digits = self._long()
            if abs(digits) > MOST_DIGITS:
                raise ValueError("too long")
            parts = struct.unpack(f"<{abs(digits)}H", self._take(2 * abs(digits)))
            size = sum(part << 15 * number for number, part in enumerate(parts))
            return size if digits > 0 else -size
        if kind == "g":
            return struct.unpack("<d", self._take(8))[0]
        if kind == "f":
            return float(self._take(self._take(1)[0]))
        if kind in "st":
            found = self._take(self._long())
            if kind == "t" and self.layout == "2.7":
                self.interned.append(found.decode("latin-1"))
                return self.interned[-1]
            return found
        if kind in "uaA":
            return self._take(self._long()).decode("utf-8", "replace")
        if kind in "zZ":
            return self._take(self._take(1)[0]).decode("latin-1")
        if kind in "Rr":
            return (self.interned if kind == "R" else self.shared)[self._long()]
        if kind in "([<>)":
            length = self._take(1)[0] if kind == ")" else self._long()
            if not 0 <= length <= MOST_OBJECTS:
                raise ValueError("too long")
            return self._counted(tuple(self.read(depth + 1) for _ in range(length)))
        if kind == "c":
            return self._code(depth)
        raise ValueError(f"unknown kind {kind!r}")

    def _counted(self, found: tuple) -> tuple:
        """Return a tuple; raise ValueError for too many values, each counted where it is used."""
        count = 1 + sum(self.counts[id(one)][0] if id(one) in self.counts else 1 for one in found)
        if count > MOST_OBJECTS:
            raise ValueError("too many values")
        self.counts[id(found)] = count, found
        return found

    def _code(self, depth: int) -> Code:
        whole, objects = LAYOUTS[self.layout]
        for _ in range(whole):
            self._long()
        found = [self.read(depth + 1) for _ in range(3)]
        instructions, constants, names = found
        variables = [self.read(depth + 1) for _ in range(3 if objects == 8 else 2)]
        for _ in range(2 if objects == 8 else 3):  # file, name, qualified name
            self.read(depth + 1)
        self._long()  # first line
        for _ in range(1 if objects == 8 else 2):
            self.read(depth + 1)
        if not isinstance(instructions, bytes) or not isinstance(constants, tuple):
            raise ValueError("no code")
        if not isinstance(names, tuple):
            raise ValueError("no names")
        free = variables[1]
        is_bytes = isinstance(free, bytes)  # 3.11: a byte of flags for each variable
        count = sum(1 for flag in free if flag & 0xC0) if is_bytes else len(free)
        texts = tuple(one.decode("latin-1") if isinstance(one, bytes) else one for one in names)
        return Code(self.layout, instructions, constants, texts, count)

    def _take(self, count: int) -> bytes:
        found = self.data[self.at : self.at + count]
        if count < 0 or len(found) != count:
            raise ValueError("truncated")
        self.at += count
        return found

    def _long(self) -> int:
        return struct.unpack("<i", self._take(4))[0]


def instructions(code: Code, wide: bool) -> Iterator[tuple[int, int]]:
    """Yield a code's operations and arguments.

    Args:
        code: function's code.
        wide: whether an operation takes one or three bytes, as before Python 3.6, not two.
    """
    at, data = 0, code.instructions
    while at < len(data):
        operation = data[at]
        if not wide:
            yield operation, data[at + 1] if at + 1 < len(data) else 0
            at += 2
        elif operation < 90:
            yield operation, 0
            at += 1
        else:
            yield operation, int.from_bytes(data[at + 1 : at + 3], "little")
            at += 3
