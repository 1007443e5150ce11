"""Render a report as one HTML page with embedded images and films."""

import base64
import os
from pathlib import Path

from zoo.report.blocks import Section
from zoo.runs.page import Page


def to_html(title: str, sections: list[Section], footer: str, folder: Path) -> str:
    """Return the text of `index.html`.

    Args:
        title: title of the report.
        sections: sections; the first has no heading.
        footer: text at the end of the page.
        folder: folder of the page; links to films that are too large for it are relative to it.
    """
    page = Page(
        Path(__file__).with_name("static") / "report.html",
        sources="img-src data:; media-src data: 'self' file:; ",
        filters={
            "base64": lambda data: base64.b64encode(data).decode(),
            "relative": lambda path: Path(os.path.relpath(path, folder)).as_posix(),
        },
        tests={"a": lambda block, name: type(block).__name__ == name},
    )
    return page.render(title=title, sections=sections, footer=footer)
