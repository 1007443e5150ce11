"""Texts in generated files, a function for each kind of file; a text may be another person's.

The last step of each function reduces the text to characters that have no meaning in its kind of
file, or replaces single characters. Nothing is removed after that, so that no mark of the language
can arise from its parts.
"""

import csv
import io
import math
import re
import shlex
from collections.abc import Iterable
from typing import Any

import yaml
from markupsafe import Markup

from zoo.base.terminal import printable

_NOT_IN_MARKDOWN = re.compile(r"[\\`*_\[\]<>#|~&${}]")
_BLOCK = re.compile(r"^(\d{0,9})([-+=.)])(?=[-+=\s]|$)")  # begins a list, a rule or a heading
_NOT_IN_TEX = re.compile(r"[<>]=|(?<![\w-])-(?=\d)|[^ \w.,:;!?()/'\"+=@-]|_")
_TEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "-": "$-$",
    ">=": r"$\geq$",
    "<=": r"$\leq$",
    **{sign: f"${sign}$" for sign in "<>|"},
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    **{sign: f"{{{sign}}}" for sign in "[]*"},  # after the end of a row, a length or a star
}
# Where one begins in a spreadsheet, some of which separate cells by semicolons.
_FORMULA = re.compile("(^|;)(?=[=+@\uff1d\uff0b\uff20]|[-\uff0d].)")
_NUMBER = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?", re.ASCII)
_SHELL_WORD = re.compile(r"[\w.,:=/@%+\[\]-]+", re.ASCII)


class _OneLineTexts(yaml.SafeDumper):
    """A writer of YAML in ASCII, each of whose texts stands in one line."""

    def represent_text(self, text: str) -> yaml.Node:
        """Return a text, in double quotes if it has control characters."""
        style = None if text.isprintable() else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_OneLineTexts.add_representer(str, _OneLineTexts.represent_text)


def yaml_text(value: object) -> str:
    r"""Return plain containers as YAML, in the order of their keys.

    >>> yaml_text({"a": "1\n---", "b": [0.5, True]})
    'a: "1\\n---"\nb:\n- 0.5\n- true\n'
    """
    return yaml.dump(value, Dumper=_OneLineTexts, sort_keys=False, width=math.inf)


def markdown_text(text: str) -> str:
    r"""Return a text as Markdown in one line, which begins no list and no heading.

    >>> print(markdown_text("1. a_b\n---"))
    1\. a\_b ---
    """
    return _BLOCK.sub(r"\1\\\2", _inline(" ".join(text.split())))


def markdown_cell(text: str) -> str:
    """Return a text as a cell of a table in Markdown; leading blanks stay visible."""
    return indented(_inline(" ".join(text.rstrip(" ").splitlines())))


def markdown_code(text: str) -> str:
    """Return a text of several lines as a block of code in Markdown."""
    fence = "`" * (1 + max([2, *map(len, re.findall("`+", text))]))
    return "\n".join([fence, *map(printable, text.splitlines()), fence])


def _inline(line: str) -> str:
    return _NOT_IN_MARKDOWN.sub(r"\\\g<0>", printable(line))


def indented(text: str) -> str:
    """Return a text with visible leading blanks: HTML and Markdown hide normal ones."""
    words = text.lstrip(" ")
    return "\N{NO-BREAK SPACE}" * (len(text) - len(words)) + words


def tex_text(text: str) -> str:
    r"""Return a text for LaTeX, in one line.

    >>> tex_text("50_% >= {x}"), tex_text("-1 to 2, 2026-01-02")
    ('50\\_\\% $\\geq$ \\{x\\}', '$-$1 to 2, 2026-01-02')
    """
    line = "".join(filter(str.isprintable, " ".join(text.split())))
    return _NOT_IN_TEX.sub(lambda sign: _TEX.get(sign[0], sign[0]), line)


def html_text(value: Any) -> Any:
    """Return a value for HTML: a text whose control characters show, but for line ends and tabs.

    Markup and other values stay. The caller escapes the text.
    """
    if not isinstance(value, str) or isinstance(value, Markup) or value.isprintable():
        return value
    return "".join(char if char in "\n\t\N{NO-BREAK SPACE}" else printable(char) for char in value)


def plot_text(text: str) -> str:
    """Return a text for matplotlib, which reads formulas between dollars."""
    return printable(text).replace("$", r"\$")


def csv_cell(value: Any) -> Any:
    """Return a value for a CSV file: in a text, no control character and no formula.

    >>> csv_cell("=HYPERLINK(x)"), csv_cell("-0.5"), csv_cell(None)
    ("'=HYPERLINK(x)", '-0.5', None)
    """
    if not isinstance(value, str) or _NUMBER.fullmatch(value):
        return value
    shown = (char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in value)
    return _FORMULA.sub(r"\1'", "".join(shown))


def csv_text(rows: Iterable[Iterable[object]], line_end: str = "\n", exact: bool = False) -> str:
    r"""Return rows as CSV; None is an empty cell.

    >>> csv_text([["a", "b,c"], [None, 0.1]])
    'a,"b,c"\n,0.1\n'

    Args:
        rows: rows of texts and numbers.
        line_end: end of each line.
        exact: whether texts stay as they are, such as paths that a reader opens.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerows(rows if exact else (map(csv_cell, row) for row in rows))
    return text.getvalue()


def shell_words(words: Iterable[str]) -> str:
    """Return words for a shell's completion, quoted as one; those with other signs are left out.

    bash and fish expand each word once more, and would run a command in it.

    >>> shell_words(["model=", "[shift]", "$(rm a)"])
    "'model= [shift]'"
    """
    return shlex.quote(" ".join(filter(_SHELL_WORD.fullmatch, words)))
