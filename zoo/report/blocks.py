"""What a write-up is made of; `zoo.report.report_page` and `zoo.report.markdown` draw it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table


class MissingError(Exception):
    """A part of the write-up cannot be made; the message says why, in a sentence."""


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Missing:
    """A line in the place of what could not be made."""

    reason: str


@dataclass(frozen=True)
class Bullets:
    """Short lines, a point each."""

    items: list[str]


@dataclass(frozen=True)
class Tile:
    """A figure of the headline."""

    label: str
    value: str
    note: str


@dataclass(frozen=True)
class Tiles:
    """The headline's figures, the most important one first."""

    tiles: list[Tile]


@dataclass(frozen=True)
class Rows:
    """A table.

    Attributes:
        headers, rows: text as it is to be shown.
        left: so many columns are words, set to the left; the rest are figures.
        bold: numbers of rows that stand out.
    """

    headers: list[str]
    rows: list[list[str]]
    left: int = 1
    bold: frozenset[int] = frozenset()

    @classmethod
    def of(cls, table: Table, left: int = 1, bold: frozenset[int] = frozenset()) -> "Rows":
        """What a table of the terminal says."""
        columns = [[_indented(str(cell)) for cell in column.cells] for column in table.columns]
        headers = [str(column.header) for column in table.columns]
        return cls(headers, [list(row) for row in zip(*columns, strict=True)], left, bold)


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes:
        name: of its file, beside the Markdown.
        data: a PNG or JPEG file's bytes.
        caption: below it; also what stands for it where it is not seen.
        plot: drawn on white, not photographed.
    """

    name: str
    data: bytes
    caption: str
    plot: bool = False

    @property
    def kind(self) -> str:
        """The media type."""
        return "image/png" if self.name.endswith(".png") else "image/jpeg"


@dataclass(frozen=True)
class Pictures:
    """Pictures in rows of so many."""

    pictures: list[Picture]
    columns: int = 1


@dataclass(frozen=True)
class Film:
    """A film: in the page itself where `data` holds it, else beside."""

    path: Path
    caption: str
    data: bytes | None = None


@dataclass(frozen=True)
class Code:
    """Lines to be typed or read as they stand."""

    text: str


@dataclass(frozen=True)
class Heading:
    """Begins a part of a section."""

    text: str


@dataclass(frozen=True)
class Box:
    """A coloured box on top of the page: what the reader came to know.

    Attributes:
        kind: `good`, `warn` or `bad`, which decides the colour.
        title: in a few words.
        lines: paragraphs.
        items: short lines below them, a point each.
        commands: what to type next, each with what it is for.
    """

    kind: str
    title: str
    lines: list[str]
    items: list[str]
    commands: list[tuple[str, str]]


@dataclass(frozen=True)
class Fold:
    """What most readers pass over: shut until it is clicked."""

    title: str
    blocks: list["Block"]


Block = Text | Missing | Bullets | Tiles | Rows | Pictures | Film | Code | Heading | Box | Fold


@dataclass(frozen=True)
class Section:
    """A part of the write-up under a heading of its own."""

    title: str
    blocks: list[Block] = field(default_factory=list)

    @property
    def anchor(self) -> str:
        """What a link to it names."""
        return self.title.lower().replace(" ", "-")


def _indented(text: str) -> str:
    """Blanks in front, which neither HTML nor Markdown would show, as ones that they do."""
    words = text.lstrip(" ")
    return "\N{NO-BREAK SPACE}" * (len(text) - len(words)) + words


def walk(blocks: list[Block]) -> list[Block]:
    """All blocks, those in folds too."""
    found = []
    for block in blocks:
        found.append(block)
        if isinstance(block, Fold):
            found += walk(block.blocks)
    return found


def gather(parts: Iterable[Callable[[Any], list[Block]]], run: Any) -> list[Block]:
    """The blocks of several parts; a line, once, in the place of a part that cannot be made."""
    blocks: list[Block] = []
    for part in parts:
        try:
            blocks += part(run)
        except MissingError as missing:
            line = Missing(str(missing))
            blocks += [] if line in blocks else [line]
    return blocks
