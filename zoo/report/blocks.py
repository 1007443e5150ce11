"""The blocks of a report; `zoo.report.report_page` and `zoo.report.markdown` render them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from zoo.runs.table import Table


class MissingError(Exception):
    """A part of the report that cannot be created; the message is a sentence with the reason."""


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Missing:
    """A line in place of a part that cannot be created."""

    reason: str


@dataclass(frozen=True)
class Bullets:
    """A list of short points."""

    items: list[str]


@dataclass(frozen=True)
class Tile:
    """One figure of the headline."""

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
        table: headings and texts of the cells.
        left: number of first columns that hold words, aligned to the left; others hold figures.
        bold: numbers of bold rows.
    """

    table: Table
    left: int = 1
    bold: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Image:
    """An image with a caption.

    Attributes:
        name: name of its file, in the Markdown's folder.
        data: bytes of a PNG or JPEG file.
        caption: text below the image, and its alternative text.
        plot: whether it is a plot on white, not a photograph.
    """

    name: str
    data: bytes
    caption: str
    plot: bool = False

    @property
    def kind(self) -> str:
        """Return the media type."""
        return "image/png" if self.name.endswith(".png") else "image/jpeg"


@dataclass(frozen=True)
class Images:
    """Images in rows of `columns`."""

    images: list[Image]
    columns: int = 1


@dataclass(frozen=True)
class Film:
    """A film: embedded in the page if `data` is set, else a link to its file."""

    path: Path
    caption: str
    data: bytes | None = None


@dataclass(frozen=True)
class Code:
    """A command or a text in a fixed-width font."""

    text: str


@dataclass(frozen=True)
class Heading:
    """The heading of a part of a section."""

    text: str


@dataclass(frozen=True)
class Box:
    """A coloured box at the top of the page with the report's main result.

    Attributes:
        kind: `good`, `warn` or `bad`, which sets the colour.
        title: result in a few words.
        lines: paragraphs.
        items: short points below the paragraphs.
        commands: pairs of a purpose and the command to type for it.
    """

    kind: str
    title: str
    lines: list[str]
    items: list[str]
    commands: list[tuple[str, str]]


@dataclass(frozen=True)
class Fold:
    """Blocks that are hidden until the reader clicks the title."""

    title: str
    blocks: list["Block"]


Block = Text | Missing | Bullets | Tiles | Rows | Images | Film | Code | Heading | Box | Fold


@dataclass(frozen=True)
class Section:
    """A section of the report with its own heading."""

    title: str
    blocks: list[Block] = field(default_factory=list)

    @property
    def anchor(self) -> str:
        """Return the target of links to the section."""
        return self.title.lower().replace(" ", "-")


def walk(blocks: list[Block]) -> list[Block]:
    """Return all blocks, with those inside folds."""
    found = []
    for block in blocks:
        found.append(block)
        if isinstance(block, Fold):
            found += walk(block.blocks)
    return found


def gather(parts: Iterable[Callable[[Any], list[Block]]], run: Any) -> list[Block]:
    """Return the blocks of several parts; a part that cannot be created becomes a line.

    The same line appears only once.
    """
    blocks: list[Block] = []
    for part in parts:
        try:
            blocks += part(run)
        except MissingError as missing:
            line = Missing(str(missing))
            blocks += [] if line in blocks else [line]
    return blocks
