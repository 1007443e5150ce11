"""A write-up as one HTML page that fetches nothing: pictures and film are within."""

import base64
import hashlib
import os
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from zoo.report.blocks import Section


def to_html(title: str, sections: list[Section], footer: str, folder: Path) -> str:
    """Return the text of `index.html`.

    Args:
        folder: a film that is too large for the page is named relative to it.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "static"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["base64"] = lambda data: base64.b64encode(data).decode()
    environment.filters["beside"] = lambda path: Path(os.path.relpath(path, folder)).as_posix()
    environment.tests["a"] = lambda block, name: type(block).__name__ == name
    style = (Path(__file__).parent / "static" / "style.css").read_text()
    template = environment.get_template("page.html")
    return template.render(
        title=title, sections=sections, footer=footer, style=style, style_source=hash_source(style)
    )


def hash_source(text: str) -> str:
    """Return the source by which a Content-Security-Policy allows this text alone, inline."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
