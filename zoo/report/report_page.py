"""Render a report as one HTML page with embedded images and films."""

import base64
import hashlib
import os
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from zoo.report.blocks import Section


def to_html(title: str, sections: list[Section], footer: str, folder: Path) -> str:
    """Return the text of `index.html`.

    Args:
        title: title of the report.
        sections: sections; the first has no heading.
        footer: text at the end of the page.
        folder: folder of the page; links to films that are too large for it are relative to it.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "static"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["base64"] = lambda data: base64.b64encode(data).decode()
    environment.filters["relative"] = lambda path: Path(os.path.relpath(path, folder)).as_posix()
    environment.tests["a"] = lambda block, name: type(block).__name__ == name
    style = (Path(__file__).parent / "static" / "style.css").read_text()
    template = environment.get_template("page.html")
    return template.render(
        title=title, sections=sections, footer=footer, style=style, style_source=hash_source(style)
    )


def hash_source(text: str) -> str:
    """Return the source with which a Content-Security-Policy allows only this inline text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
