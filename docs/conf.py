"""Configure the manual: `make docs` builds it into `docs/_build`, without a network."""

import importlib.metadata
import os
import re

from sphinx.application import Sphinx

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")

project = "drivezoo"
author = "the authors of drivezoo"
copyright = author
release = importlib.metadata.version("drivezoo")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

# Headings get an id as on GitHub, so that page.md#a-heading works there and here.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = "drivezoo"
html_static_path = ["_static"]
html_css_files = ["tables.css"]
html_copy_source = False
html_show_sphinx = False

# Only `make docs-links` opens pages of other sites.
linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_anchors = False


def escape_bars(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]):
    """Show `|x|`, an absolute value, as it stands: Sphinx would substitute it."""
    lines[:] = [re.sub(r"\|(\w+)\|", r"\|\1\|", line) for line in lines]


def setup(app: Sphinx) -> None:
    """Register what changes docstrings on their way into the manual."""
    app.connect("autodoc-process-docstring", escape_bars)
