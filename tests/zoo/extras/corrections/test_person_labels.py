"""The file of labels that a person fills in, as editors and spreadsheet programs save it."""

from pathlib import Path

import pytest

from zoo.base.errors import InputError
from zoo.extras.corrections.person_corrections import read_labels

HEADER = "override,image,seconds_before,sent,steering"
ROW = "1,IMG/a.jpg,0.50,0.100,"


@pytest.mark.parametrize("steering", ["0.5", "0,5", '"0,5"', " ,5 ", "0.5,,"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "cp1252"])
def test_a_number_may_have_a_decimal_comma(steering: str, encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    lines = [HEADER, ROW + steering, "1,IMG/b.jpg,0.00,0.100,", "1,IMG/ü.jpg,0.00,0.100,-1"]
    path.write_text("\n".join(lines), encoding=encoding)
    labels = read_labels(path)
    assert labels.pop("IMG/a.jpg") == 0.5
    assert list(labels.values()) == [-1]


def test_columns_may_be_separated_by_semicolons(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text(f"{HEADER}\n{ROW}".replace(",", ";") + "-0,5\n")
    assert read_labels(path) == {"IMG/a.jpg": -0.5}


@pytest.mark.parametrize(
    ("text", "encoding", "words"),
    [
        (f"{HEADER}\n{ROW}0.5", "utf-16", "row 1: .*save it as UTF-8"),
        (f"{HEADER}\n{ROW}left", "utf-8", r"row 2: .*a\.jpg.*left.*-1\.\.1"),
        (f"{HEADER}\n{ROW}1,5", "utf-8", r"row 2: .*1,5.*-1\.\.1"),
        (f"{HEADER}\n{ROW}0.5,a note", "utf-8", r"row 2: .*a note.*last column"),
        (f'{HEADER}\n{ROW}"0.5\n{ROW}0.5"', "utf-8", "row 2: a quote"),
        (f"{HEADER}\n{ROW}", "utf-8", "steering column is empty"),
    ],
)
def test_what_is_no_steering_is_named(text: str, encoding: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_text(text, encoding=encoding)
    with pytest.raises(InputError, match=rf"labels\.csv.*{words}"):
        read_labels(tmp_path / "labels.csv")
