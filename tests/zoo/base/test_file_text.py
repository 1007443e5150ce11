"""Texts of strangers in generated files: with every control character at every place, only text."""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib.text
import pytest
import yaml
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from tests.slow_members import slow
from zoo.base.errors import UsageError
from zoo.base.file_text import (
    csv_text,
    markdown_cell,
    markdown_code,
    markdown_text,
    shell_words,
    tex_text,
    yaml_text,
)
from zoo.base.terminal import printable
from zoo.commands.new import write_part
from zoo.runs.plots import interval_panels
from zoo.runs.result_table import Table
from zoo.runs.table_files import write_plot
from zoo.scoring.blocks import Bullets, Code, Heading, Rows, Section, Text, to_html, to_markdown

CONTROLS = [
    *map(chr, [*range(32), *range(127, 160), 0xAD, 0x200B, 0x202E, 0x2028, 0x2029, 0xFEFF]),
    "\udc80",  # half a character
]
MARKDOWN = MarkdownIt("commonmark").enable(["table", "strikethrough"])


def spoiled(*payloads: str) -> Iterator[str]:
    """Yield each text, and with each control character at each of its places."""
    for payload in payloads:
        yield payload
        for at in range(len(payload) + 1):
            for control in CONTROLS:
                yield payload[:at] + control + payload[at:]


def test_yaml_holds_the_same_texts_in_a_line_each() -> None:
    for text in spoiled("a\n---\nsha256: 0", "'\": #&*!|>%@`", "- x\n  - y: z"):
        value = {"a": text, text: [text]}
        written = yaml_text(value)
        assert len(written.splitlines()) == 3
        assert all(line.isascii() and line.isprintable() for line in written.splitlines())
        if "\udc80" not in text:  # which no reader takes
            assert yaml.safe_load(written) == value


QUICK_MARKS = (
    "<script>x</script>", "[a](http://b)", "```\n# a", "a\n\n- b\n1. c", "    a", "> a",
)  # fmt: skip
# Texts whose control characters take seconds; without these, `QUICK_MARKS` and they are plain.
SLOW_MARKS = (
    "![a](b)", "*a* _b_ ~~c~~", "1) a", "===", "---", "| a | b |\n|---|---|", "&lt;b&gt;",
    "\\[a](b)", "+ a",
)  # fmt: skip
MARKS_OF_MARKDOWN = (*QUICK_MARKS, *SLOW_MARKS)


def tokens(markdown: str) -> list[str]:
    """Return the kinds of a Markdown text's tokens, with those inside lines."""
    parsed = MARKDOWN.parse(markdown)
    return [token.type for token in parsed] + [
        "text" if child.type == "text_special" else child.type
        for token in parsed
        for child in token.children or ()
    ]


@pytest.mark.parametrize("payload", [*QUICK_MARKS, *slow(*SLOW_MARKS)])
def test_markdown_shows_a_text_alone(payload: str) -> None:
    table = tokens(Table.of(["a"], [["b"]]).markdown())
    for text in spoiled(payload):
        line = markdown_text(text)
        assert set(tokens(line)) <= {"paragraph_open", "inline", "paragraph_close", "text"}
        shown = "".join(token.content for token in MARKDOWN.parseInline(line)[0].children)
        assert shown == printable(" ".join(text.split()))
        assert tokens(f"| {markdown_cell(text)} |\n| --- |\n| {markdown_cell(text)} |") == table
        assert tokens(markdown_code(text)) == ["fence"]


def test_a_report_of_hostile_texts_has_the_same_parts() -> None:
    def report(text: str) -> list[str]:
        blocks = [Text(text), Bullets([text]), Heading(text), Code(text)]
        rows = Rows(Table.of(["a"], [[text]]))
        return tokens(to_markdown(text, [Section("", blocks), Section(text, [rows])]))

    expected = report("x")
    assert all(report(text) == expected for text in MARKS_OF_MARKDOWN)


TEX = re.compile(
    r"\\text(backslash|asciitilde|asciicircum)\{\}|\$(\\pm|\\geq|\\leq|[<>|-])\$|"
    r"\\[&%$#_{}]|\{[\[\]*]\}"
)


def test_tex_has_no_command_of_a_text() -> None:
    for text in spoiled("\\input{/etc/passwd}", "^^5cinput", "[1em]", "*", "a}%$#_&~|<>=-1", "±\\"):
        written = tex_text(text)
        assert written.isprintable()
        assert not set(TEX.sub("", written)) & set("\\{}$&%#_^~[]*"), ascii(text)


class Tags(HTMLParser):
    """The elements of a page, counted, with their attributes' names; and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.counts, self.data = Counter(), []
        self.feed(page)

    def handle_starttag(self, tag: str, attributes: list) -> None:
        self.counts[(tag, *(name for name, _ in attributes))] += 1

    def handle_data(self, data: str) -> None:
        self.data.append(data)


MARKS_OF_HTML = ("</li><script>x</script>", "\" onload='x'", "<!-- -->", "]]>", "&#60;b>")


@pytest.mark.parametrize("payload", MARKS_OF_HTML)
def test_a_page_of_hostile_texts_has_the_same_elements(payload: str) -> None:
    texts = [text for text in spoiled(payload) if text.isprintable() or "\n" not in text]

    def page(texts: list[str]) -> Tags:
        blocks = [Bullets(texts), Rows(Table.of(["a"], [[cell] for cell in texts]))]
        return Tags(to_html(texts[0], [Section("", blocks)], footer=texts[-1]))

    shown_page = page(texts)
    assert shown_page.counts == page(["x"] * len(texts)).counts
    shown = "".join(shown_page.data).replace("\n", "").replace("\t", "").replace("\xa0", "")
    assert shown.isprintable()
    table = Tags(Table.of(["a"], [[cell] for cell in texts]).html())
    tags = {"table", "caption", "thead", "tbody", "tr", "th", "td"}
    assert {tag for tag, *_ in table.counts} == tags


ODD_NAMES = ("a$\\foo$", "a$x$", "a_$b", "-->\x00<script>", "\x1b\u202e")


@pytest.mark.parametrize("name", ODD_NAMES)
def test_a_plot_shows_a_name_as_it_is(name: str, tmp_path: Path) -> None:
    figure = SimpleNamespace(value=0.5, low=0.4, high=0.6)
    check_shown_name(name, interval_panels({"x": ({name: figure}, 1)}), tmp_path)


def check_shown_name(name: str, plot: Figure, tmp_path: Path) -> None:
    """Check that a plot's files show a name as it is, whatever it holds."""
    for ending in (".pdf", ".svg"):
        path = write_plot(plot, tmp_path / f"plot{ending}")
    shown = [artist.get_text() for artist in plot.findobj(matplotlib.text.Text)]
    assert printable(name).replace("$", "\\$") in shown
    assert ElementTree.parse(path).getroot().tag.endswith("svg")


FORMULAS = (
    '=HYPERLINK("http://x","y")', "+1+2", "-1+cmd|' /C calc'!A0", "@SUM(1)", "a;=1", "\uff1d1",
    'a","=1', "a\n=1",
)  # fmt: skip


@pytest.mark.parametrize("payload", FORMULAS)
def test_a_csv_cell_is_neither_a_formula_nor_two_cells(payload: str) -> None:
    for text in spoiled(payload):
        written = csv_text([[text, "x"]])
        assert len(written.splitlines()) == 1
        (row,) = csv.reader(io.StringIO(written))
        assert len(row) == 2
        assert not re.search("(^|;)[=+@\uff1d-]", row[0]), ascii(text)


@pytest.mark.parametrize("cell", ["-0.5", "+1e-05", "-", "a-b", "-12", "x=1", "", None, -0.5])
def test_a_csv_cell_keeps_figures_and_plain_words(cell: object) -> None:
    assert csv_text([[cell, 1]]) == f"{'' if cell is None else cell},1\n"


def test_exact_csv_keeps_paths() -> None:
    assert csv_text([["=a/\x1b.jpg"]], exact=True) == "=a/\x1b.jpg\n"


def test_no_word_of_a_completion_is_a_command() -> None:
    for text in spoiled("$(touch x)", "`touch x`", "a' b", "a;b", "a b", "(touch x)"):
        assert shell_words(["model=", text, "[shift]"]) == "'model= [shift]'"


@pytest.mark.parametrize("kind", ["notebook", "study", "model"])
def test_a_notebooks_name_holds_no_other_text(kind: str, tmp_path: Path) -> None:
    for name in spoiled("a"):
        if name != "a":
            with pytest.raises(UsageError):
                write_part(kind, name, tmp_path)
    assert not [*tmp_path.iterdir()]
