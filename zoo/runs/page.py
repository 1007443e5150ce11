"""Self-contained HTML pages: templates, style, script, escaping and Content-Security-Policy."""

import base64
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from zoo.base.file_text import html_text, indented
from zoo.base.page_requests import STATIC

SHARED = Path(__file__).with_name("static")
SERVED = "/* Served */"  # the style sheet's part of pages that a command serves begins there


@dataclass(frozen=True)
class Page:
    """A page without anything from outside; its policy allows its own style and script alone.

    Attributes:
        template: file of the template, in Jinja's language, which extends `base.html`.
        script: name of the script's file, beside the template; empty for none.
        sources: further sources that the policy allows, such as `img-src data:; `.
        tests: tests of the template by name.
    """

    template: Path
    script: str = ""
    sources: str = ""
    tests: Mapping[str, Callable] = field(default_factory=dict)

    def render(self, title: str, **values: Any) -> str:
        """Return the page's text; values that are not marked as safe are escaped."""
        folder = self.template.parent
        environment = Environment(
            loader=FileSystemLoader([folder, SHARED]),
            autoescape=True,
            finalize=html_text,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        environment.filters |= {"indented": indented, "base64": _base64}
        environment.tests |= self.tests
        style = (STATIC / "style.css").read_text(encoding="utf-8").partition(SERVED)[0]
        script = (folder / self.script).read_text(encoding="utf-8") if self.script else ""
        scripts = f"script-src {hash_source(script)}; " if script else ""
        policy = (
            f"default-src 'none'; {self.sources}style-src {hash_source(style)}; {scripts}"
            "base-uri 'none'; form-action 'none'"
        )
        template = environment.get_template(self.template.name)
        return template.render(title=title, policy=policy, style=style, script=script, **values)


def last_folders(path: str | Path) -> str:
    r"""Return a path for a page that others read: below the current folder, or its last two parts.

    >>> last_folders(Path.cwd() / "outputs" / "run"), last_folders("/home/ada/old/outputs/run")
    ('outputs/run', 'outputs/run')
    >>> last_folders("s3://shards/lake"), last_folders(r"C:\Users\ada\run")
    ('s3://shards/lake', 'ada/run')
    """
    here = Path.cwd()
    if Path(path) != here and Path(path).is_relative_to(here):
        return Path(path).relative_to(here).as_posix()
    named = PureWindowsPath(path)  # its separators are those of all systems
    return "/".join(named.parts[1:][-2:]) if named.anchor else str(path)


def hash_source(text: str) -> str:
    """Return the source with which a Content-Security-Policy allows only this inline text."""
    return f"'sha256-{_base64(hashlib.sha256(text.encode()).digest())}'"


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
