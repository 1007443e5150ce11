"""Render a report as Markdown, with its images as files in the same folder."""

import os
from pathlib import Path

from zoo.report.blocks import (
    Block,
    Box,
    Bullets,
    Code,
    Film,
    Fold,
    Heading,
    Image,
    Images,
    Missing,
    Rows,
    Section,
    Text,
    Tiles,
)


def to_markdown(title: str, sections: list[Section], folder: Path) -> str:
    """Return the text of `report.md`.

    Args:
        title: title of the report.
        sections: sections; the first has no heading.
        folder: folder of `report.md`; paths of films are relative to it.
    """
    parts = [f"# {_plain(title)}"]
    for number, section in enumerate(sections):
        if number:  # the headline follows the title
            parts.append(f"## {section.title}")
        parts += [_block(block, folder) for block in section.blocks]
    return "\n\n".join(part for part in parts if part) + "\n"


def _block(block: Block, folder: Path) -> str:
    match block:
        case Text(text):
            return _plain(text)
        case Missing(reason):
            return f"*{_plain(reason)}*"
        case Heading(text):
            return f"### {_plain(text)}"
        case Bullets(items):
            return "\n".join(f"- {_plain(item)}" for item in items)
        case Tiles(tiles):
            rows = [[tile.label, tile.value, tile.note] for tile in tiles]
            return _table(Rows(["figure", "value", "details"], rows, left=3))
        case Rows():
            return _table(block)
        case Images(images, columns):
            return _images(images, columns)
        case Film(path, caption):
            return f"[{_plain(caption)}](<{Path(os.path.relpath(path, folder)).as_posix()}>)"
        case Code(text):
            fence = "````" if "```" in text else "```"
            return f"{fence}\n{text.rstrip()}\n{fence}"
        case Box(_, title, lines, items, commands):
            bullets = "\n".join(f"- {_plain(item)}" for item in items)
            typed = [f"{_plain(purpose)}:\n\n    {command}" for purpose, command in commands]
            parts = [f"**{_plain(title)}**", *map(_plain, lines), bullets, *typed]
            return "\n\n".join(part for part in parts if part)
        case Fold(title, blocks):
            inner = "\n\n".join(_block(one, folder) for one in blocks)
            return f"<details><summary>{_plain(title)}</summary>\n\n{inner}\n\n</details>"
    raise TypeError(f"{type(block).__name__} is not a block")


def _table(rows: Rows) -> str:
    rule = ["---" if column < rows.left else "---:" for column in range(len(rows.headers))]
    lines = [[_cell(header) for header in rows.headers], rule]
    for number, row in enumerate(rows.rows):
        bold = number in rows.bold
        lines.append([f"**{_cell(c)}**" if bold and c else _cell(c) for c in row])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _images(images: list[Image], columns: int) -> str:
    """Return images one below another, or side by side in a table with a header row of images."""
    if columns == 1:
        return "\n\n".join(f"{_image(one)}\n\n{_plain(one.caption)}" for one in images)
    cells = [f"{_image(one)}<br>{_cell(one.caption)}" for one in images]
    cells += [""] * (-len(cells) % columns)
    rows = [cells[start : start + columns] for start in range(0, len(cells), columns)]
    lines = [rows[0], ["---"] * columns, *rows[1:]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _image(image: Image) -> str:
    return f"![{Path(image.name).stem}](<{image.name}>)"


def _plain(text: str) -> str:
    """Return a text with Markdown's special characters escaped."""
    for character in "\\`*_[]<>#":
        text = text.replace(character, f"\\{character}")
    return text


def _cell(text: str) -> str:
    return _plain(text.strip(" ")).replace("|", "\\|").replace("\n", " ")
