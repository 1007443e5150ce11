"""What each ending of `table=` must do: its columns, its texts or figures, and escaping."""

import csv
import io
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from zoo.base.errors import InputError, UsageError
from zoo.runs.result_table import Column, Table
from zoo.runs.table_files import FORMS, TableFiles, write_table

HOSTILE = "<b>a|b_1</b> & 5%"
FIGURES = {"autonomy": [0.98, None], "autonomy_std": [0.01, None]}
TABLE = Table(
    [
        Column("network", "network", [HOSTILE, "lenet"]),
        Column("autonomy", "autonomy", ["98% ± 1%", "-"], FIGURES),
        Column("seconds", "seconds", ["-5", "7"], {"seconds": [-5.25, 7.0]}, short=False),
    ],
    "Drives on 3 roads_",
)
OF_FIGURES = (".csv", ".parquet")


class Cells(HTMLParser):
    """A parser of the cells of a page's table."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in {"meta", "table", "caption", "thead", "tbody", "tr", "th", "td"}
        if tag == "tr":
            self.rows.append([])
        elif tag in ("th", "td"):
            self.rows[-1].append("")

    def handle_data(self, data: str) -> None:
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


def read(path: Path) -> list[list[object]]:
    """Return the rows of a table's file as a program reads them, the headings first."""
    if path.suffix == ".parquet":
        table = pytest.importorskip("pyarrow.parquet").read_table(path)
        return [table.column_names, *map(list, zip(*table.to_pydict().values(), strict=True))]
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".csv":
        return list(csv.reader(io.StringIO(text)))
    if path.suffix == ".html":
        return [[cell.strip() for cell in row] for row in Cells(text).rows]
    if path.suffix == ".md":
        plain = text.replace(r"\|", "¦").replace("\\", "")
        rows = [line.strip("|").split("|") for line in plain.splitlines()]
        return [[cell.strip().replace("¦", "|") for cell in row] for row in (rows[0], *rows[2:])]
    texts = {r"$<$": "<", r"$>$": ">", r"$|$": "|", r"$\pm$": "±", "$-$": "-", "\\": ""}
    rows = [line.removesuffix(r" \\").split(" & ") for line in text.split("\n") if r" \\" in line]
    for tex, plain in texts.items():
        rows = [[cell.replace(tex, plain) for cell in row] for row in rows]
    return rows


@pytest.mark.parametrize("ending", FORMS)
def test_a_table_in_a_file_is_read_as_it_was(ending: str, tmp_path: Path) -> None:
    path = write_table(TABLE, tmp_path / f"table{ending}", "network,autonomy,seconds")
    heads, first, second = read(path)
    spread = ["autonomy_std"] if ending in OF_FIGURES else []
    assert heads == ["network", "autonomy", *spread, "seconds"]
    assert first[0] == HOSTILE
    if ending in OF_FIGURES:
        assert [float(cell) for cell in first[1:]] == [0.98, 0.01, -5.25]
        assert second[1:3] == (["", ""] if ending == ".csv" else [None, None])
    else:
        assert first[1:] == ["98% ± 1%", "-5"]


@pytest.mark.parametrize("ending", FORMS)
def test_columns_are_chosen_in_their_order(ending: str, tmp_path: Path) -> None:
    path = write_table(TABLE, tmp_path / f"table{ending}", "seconds, network")
    assert read(path)[0] == ["seconds", "network"]
    with pytest.raises(UsageError, match="no column autnomy; did you mean autonomy"):
        write_table(TABLE, tmp_path / f"other{ending}", "autnomy")


@pytest.mark.parametrize("ending", FORMS)
def test_a_table_without_rows_has_its_headings(ending: str, tmp_path: Path) -> None:
    empty = Table.of(["network", "autonomy"], [])
    assert read(write_table(empty, tmp_path / f"table{ending}")) == [["network", "autonomy"]]


def test_tex_alone_has_the_main_columns_by_default(tmp_path: Path) -> None:
    for ending in FORMS:
        heads = read(write_table(TABLE, tmp_path / f"table{ending}"))[0]
        assert ("seconds" in heads) == (ending != ".tex")


def test_a_caption_makes_the_tex_table_a_float() -> None:
    text = TABLE.tex()
    assert r"\caption{Drives on 3 roads\_}" in text
    for name in ("table", "adjustbox", "tabular"):
        assert text.count(rf"\begin{{{name}}}") == text.count(rf"\end{{{name}}}") == 1
    assert r"\begin{table}" not in replace(TABLE, caption="").tex()


@pytest.mark.parametrize(
    ("columns", "fault"),
    [
        ("autnomy", "no column autnomy;"),
        ("network,network", "names network twice"),
        ("", "no column without a name;"),
    ],
)
def test_a_wrong_column_is_named_before_the_work(columns: str, fault: str) -> None:
    with pytest.raises(UsageError, match=f"columns={columns}: .*{fault}"):
        TableFiles(table="a.tex", columns=columns).check_files(["network", "autonomy"])


def test_other_endings_and_columns_without_a_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must end in \.csv, .* or \.html"):
        TableFiles(table=str(tmp_path / "a.xlsx")).check_files()
    with pytest.raises(UsageError, match="table=FILE"):
        TableFiles(columns="autonomy").check_files()
