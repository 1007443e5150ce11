"""Self-contained HTML pages: template, style, script, escaping and Content-Security-Policy."""

import base64
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


@dataclass(frozen=True)
class Page:
    """A page without anything from outside; its policy allows its own style and script alone.

    The template gets `policy`, `style` and `script` in addition to its values.

    Attributes:
        folder: folder of the files below.
        template: name of the template, in Jinja's language.
        style: name of the style's file.
        script: name of the script's file; empty for none.
        sources: further sources that the policy allows, such as `img-src data:; `.
        trim: whether lines of the template that hold only a statement leave no empty line.
        filters: filters of the template by name.
        tests: tests of the template by name.
    """

    folder: Path
    template: str = "page.html"
    style: str = "style.css"
    script: str = ""
    sources: str = ""
    trim: bool = False
    filters: Mapping[str, Callable] = field(default_factory=dict)
    tests: Mapping[str, Callable] = field(default_factory=dict)

    def render(self, **values: Any) -> str:
        """Return the page's text; values that are not marked as safe are escaped."""
        environment = Environment(
            loader=FileSystemLoader(self.folder),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=self.trim,
            lstrip_blocks=self.trim,
        )
        environment.filters.update(self.filters)
        environment.tests.update(self.tests)
        style, script = (
            (self.folder / one).read_text(encoding="utf-8") if one else ""
            for one in (self.style, self.script)
        )
        scripts = f"script-src {hash_source(script)}; " if script else ""
        policy = (
            f"default-src 'none'; {self.sources}style-src {hash_source(style)}; {scripts}"
            "base-uri 'none'; form-action 'none'"
        )
        template = environment.get_template(self.template)
        return template.render(policy=policy, style=style, script=script, **values)


def hash_source(text: str) -> str:
    """Return the source with which a Content-Security-Policy allows only this inline text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
