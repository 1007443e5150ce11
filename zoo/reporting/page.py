"""A write-up as one HTML page that fetches nothing: pictures and film are within."""

import base64
import os
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from zoo.reporting.blocks import Section


def to_html(title: str, sections: list[Section], footer: str, folder: Path) -> str:
    """The text of `index.html`; a film that is too large for it is named relative to `folder`."""
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
    return template.render(title=title, sections=sections, footer=footer, style=style)
