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
from zoo.runs.table import Table, markdown_cell, markdown_escape


def to_markdown(title: str, sections: list[Section], folder: Path) -> str:
    """Return the text of `report.md`.

    Args:
        title: title of the report.
        sections: sections; the first has no heading.
        folder: folder of `report.md`; paths of films are relative to it.
    """
    parts = [f"# {markdown_escape(title)}"]
    for number, section in enumerate(sections):
        if number:  # the headline follows the title
            parts.append(f"## {section.title}")
        parts += [_block(block, folder) for block in section.blocks]
    return "\n\n".join(part for part in parts if part) + "\n"


def _block(block: Block, folder: Path) -> str:
    match block:
        case Text(text):
            return markdown_escape(text)
        case Missing(reason):
            return f"*{markdown_escape(reason)}*"
        case Heading(text):
            return f"### {markdown_escape(text)}"
        case Bullets(items):
            return "\n".join(f"- {markdown_escape(item)}" for item in items)
        case Tiles(tiles):
            rows = [[tile.label, tile.value, tile.note] for tile in tiles]
            return Table.of(["figure", "value", "details"], rows).markdown()
        case Rows(table, left, bold):
            return table.markdown(left, bold)
        case Images(images, columns):
            return _images(images, columns)
        case Film(path, caption):
            return (
                f"[{markdown_escape(caption)}](<{Path(os.path.relpath(path, folder)).as_posix()}>)"
            )
        case Code(text):
            fence = "````" if "```" in text else "```"
            return f"{fence}\n{text.rstrip()}\n{fence}"
        case Box(_, title, lines, items, commands):
            bullets = "\n".join(f"- {markdown_escape(item)}" for item in items)
            typed = [
                f"{markdown_escape(purpose)}:\n\n    {command}" for purpose, command in commands
            ]
            parts = [f"**{markdown_escape(title)}**", *map(markdown_escape, lines), bullets, *typed]
            return "\n\n".join(part for part in parts if part)
        case Fold(title, blocks):
            inner = "\n\n".join(_block(one, folder) for one in blocks)
            return f"<details><summary>{markdown_escape(title)}</summary>\n\n{inner}\n\n</details>"
    raise TypeError(f"{type(block).__name__} is not a block")


def _images(images: list[Image], columns: int) -> str:
    """Return images one below another, or side by side in a table with a header row of images."""
    if columns == 1:
        return "\n\n".join(f"{_image(one)}\n\n{markdown_escape(one.caption)}" for one in images)
    cells = [f"{_image(one)}<br>{markdown_cell(one.caption)}" for one in images]
    cells += [""] * (-len(cells) % columns)
    rows = [cells[start : start + columns] for start in range(0, len(cells), columns)]
    lines = [rows[0], ["---"] * columns, *rows[1:]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _image(image: Image) -> str:
    return f"![{Path(image.name).stem}](<{image.name}>)"
