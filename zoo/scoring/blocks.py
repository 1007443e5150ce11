"""The blocks of a report, and the page and the Markdown that are rendered from them."""

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import numpy as np
import PIL.Image
from markupsafe import Markup

from datamodules.image import MOST_IMAGE_BYTES, encode_image
from zoo.base.bounded_files import read_regular
from zoo.base.file_text import markdown_cell, markdown_code
from zoo.base.file_text import markdown_text as plain
from zoo.base.terminal import printable
from zoo.runs.page import Page
from zoo.runs.result_table import Table

QUALITY = 88  # of JPEG images


class Block:
    """A block of a section; `static/report.html` has its HTML."""

    def markdown(self) -> str:
        """Return the block as Markdown."""
        raise NotImplementedError


@dataclass(frozen=True)
class Text(Block):
    """A paragraph."""

    form = "{}"  # of its Markdown
    text: str

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        return self.form.format(plain(self.text))


class Missing(Text):
    """A line in place of a part that cannot be created."""

    form = "*{}*"


class Heading(Text):
    """The heading of a part of a section."""

    form = "### {}"


class Code(Text):
    """A command or a text in a fixed-width font."""

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        return markdown_code(self.text.rstrip())


@dataclass(frozen=True)
class Bullets(Block):
    """A list of short points."""

    items: Sequence[str]

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        return "\n".join(f"- {plain(item)}" for item in self.items)


@dataclass(frozen=True)
class Tiles(Block):
    """The headline's figures, the most important one first: each a label, a value and details."""

    tiles: Sequence[tuple[str, str, str]]

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        return Table.of(["figure", "value", "details"], self.tiles).markdown()


@dataclass(frozen=True)
class Rows(Block):
    """A table.

    Attributes:
        table: headings and texts of the cells.
        left: number of first columns that hold words, aligned to the left; others hold figures.
        bold: numbers of bold rows.
    """

    table: Table
    left: int = 1
    bold: frozenset[int] = frozenset()

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        return self.table.markdown(self.left, self.bold)


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

    @classmethod
    def jpeg(cls, name: str, pixels: np.ndarray, caption: str) -> "Image":
        """Return pixels, uint8 [H, W, 3] RGB, as a JPEG."""
        return cls(name, encode_image(pixels, quality=QUALITY), caption)

    @classmethod
    def read(cls, path: Path, caption: str, name: str = "", plot: bool = True) -> "Image":
        """Return an image file of a run, which may come from another person.

        Raises:
            OSError: the file is missing, not regular or too large.
        """
        return cls(name or path.name, read_regular(str(path), MOST_IMAGE_BYTES), caption, plot)

    @property
    def size(self) -> str:
        """Return its size as HTML's attributes, so that it keeps its place while a page loads.

        Empty for a damaged file, of a run of any origin.
        """
        try:
            with PIL.Image.open(io.BytesIO(self.data)) as image:
                return Markup('width="{}" height="{}"').format(*image.size)
        except (OSError, ValueError, PIL.Image.DecompressionBombError):
            return Markup()

    @property
    def kind(self) -> str:
        """Return the media type."""
        return "image/png" if self.name.endswith(".png") else "image/jpeg"


@dataclass(frozen=True)
class Images(Block):
    """Images in rows of `columns`."""

    images: list[Image]
    columns: int = 1

    def markdown(self) -> str:
        """Return images one below another, or side by side in a table with images as headings."""
        links = [
            f"![{plain(Path(image.name).stem)}](<{quote(image.name)}>)" for image in self.images
        ]
        pairs = list(zip(links, (image.caption for image in self.images), strict=True))
        if self.columns == 1:
            return "\n\n".join(f"{link}\n\n{plain(caption)}" for link, caption in pairs)
        cells = [f"{link}<br>{markdown_cell(caption)}" for link, caption in pairs]
        cells += [""] * (-len(cells) % self.columns)
        rows = [cells[at : at + self.columns] for at in range(0, len(cells), self.columns)]
        lines = [rows[0], ["---"] * self.columns, *rows[1:]]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)


@dataclass(frozen=True)
class Film(Block):
    """A film: embedded in the page if `data` is set, else a link to its file.

    Attributes:
        link: path of its file, from the page's folder.
        caption: text below the film.
        data: bytes of the file.
        poster: image that stands in its place until it plays; None for its first frame.
    """

    link: str
    caption: str
    data: bytes | None = None
    poster: Image | None = None

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        return f"[{plain(self.caption)}](<{quote(self.link)}>)"


@dataclass(frozen=True)
class Box(Block):
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
    lines: Sequence[str]
    items: Sequence[str]
    commands: Sequence[tuple[str, str]]

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        typed = [
            f"{plain(purpose)}:\n\n    {printable(command)}" for purpose, command in self.commands
        ]
        bullets = Bullets(self.items).markdown()
        return _joined([f"**{plain(self.title)}**", *map(plain, self.lines), bullets, *typed])


@dataclass(frozen=True)
class Fold(Block):
    """Blocks that are hidden until the reader clicks the title."""

    title: str
    blocks: list[Block]

    def markdown(self) -> str:
        """Return Markdown, see `Block`."""
        inner = "\n\n".join(block.markdown() for block in self.blocks)
        return f"<details><summary>{plain(self.title)}</summary>\n\n{inner}\n\n</details>"


@dataclass(frozen=True)
class Section:
    """A section of the report with its own heading; a folded one shows it alone until clicked."""

    title: str
    blocks: list[Block] = field(default_factory=list)
    folded: bool = False

    @property
    def anchor(self) -> str:
        """Return the target of links to the section."""
        return self.title.lower().replace(" ", "-")


def images_of(blocks: Sequence[Block]) -> list[Image]:
    """Return all images of blocks, with those inside folds."""
    images: list[Image] = []
    for block in blocks:
        if isinstance(block, Images):
            images += block.images
        elif isinstance(block, Fold):
            images += images_of(block.blocks)
    return images


def to_markdown(title: str, sections: Sequence[Section]) -> str:
    """Return the text of `report.md`; the first section has no heading."""
    parts = [f"# {plain(title)}"]
    for number, section in enumerate(sections):
        parts.append(f"## {plain(section.title)}" if number else "")
        parts += [block.markdown() for block in section.blocks]
    return _joined(parts) + "\n"


def to_html(title: str, sections: Sequence[Section], footer: str) -> str:
    """Return the text of `index.html`, with embedded images and films.

    Args:
        title: title of the report.
        sections: sections; the first has no heading.
        footer: text at the end of the page.
    """
    page = Page(
        Path(__file__).with_name("static") / "report.html",
        sources="img-src data:; media-src data: 'self' file:; ",
        tests={"a": lambda block, name: type(block).__name__ == name},
    )
    return page.render(title=title, sections=sections, footer=footer)


def _joined(parts: Iterable[str]) -> str:
    return "\n\n".join(part for part in parts if part)
