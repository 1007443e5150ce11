"""Tables as people have them: separators, headers, positions, paths of other machines."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from datamodules.recording import Recording, file_name
from datamodules.recording_format import read_recordings
from datamodules.stretches import missing_rows
from tests import foreign_recordings as foreign
from zoo.base.errors import InputError, UsageError

NAMED = {"image": "image", "steering": "steering"}
PLACED = {"image": 0, "steering": 1}
HEADER = "image,steering"


def write(folder: Path, header: str, path: str = "IMG/{}.jpg", form: str = "{path},{turn}") -> Path:
    foreign.write_frames(folder / "IMG", [f"{row}.jpg" for row in range(foreign.ROWS)])
    lines = [
        form.format(path=path.format(row), turn=f"{turn:.6f}", row=row)
        for row, turn in enumerate(foreign.STEERING.tolist())
    ]
    (folder / "labels.csv").write_text("\n".join([header, *lines, ""] if header else [*lines, ""]))
    return folder / "labels.csv"


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return write(tmp_path / "set", HEADER)


def read(table: Path, columns: object = NAMED, **options: object) -> Recording:
    return read_recordings(str(table), format="table", columns=columns, **options)


def check_whole(recording: Recording) -> None:
    assert recording.steering == pytest.approx(foreign.STEERING, abs=1e-6)
    assert Path(recording.images[7, 0]).name == "7.jpg"


LAYOUTS = {
    "commas": (HEADER, "{path},{turn}", NAMED),
    "semicolons": ("image;steering", "{path};{turn}", NAMED),
    "tabs": ("image\tsteering", "{path}\t{turn}", NAMED),
    "bars": ("image|steering", "{path}|{turn}", NAMED),
    "bars, three columns": ("t|image|steering", "{row}|{path}|{turn}", NAMED),
    "no header": ("", "{path},{turn}", PLACED),
    "no header, texts": ("", "{path},{turn}", "{image: 0, steering: 1}"),
    "no header, semicolons": ("", "{path};{turn}", PLACED),
    "no header, more columns": ("", "{row},{path},{turn},3", {"image": 1, "steering": 2}),
    "header, positions": (HEADER, "{path},{turn}", PLACED),
    "pandas": (f",{HEADER}", "{row},{path},{turn}", NAMED),
    "pandas, numbers": (",0,1", "{row},{path},{turn}", PLACED),
    "numbers": ("0,1", "{path},{turn}", PLACED),
    "trailing comma": (HEADER, "{path},{turn},", NAMED),
    "trailing commas": (f"{HEADER},", "{path},{turn},,", NAMED),
    "trailing comma, header alone": (f"{HEADER},", "{path},{turn}", NAMED),
    "blank lines": (f"\n{HEADER}\n", "{path},{turn}\n", NAMED),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_table_of_every_layout_is_read(name: str, tmp_path: Path) -> None:
    header, form, columns = LAYOUTS[name]
    recording = read(table := write(tmp_path / "set", header, form=form), columns)
    check_whole(recording)
    assert recording.names == (str(table),), "its folder may hold others"
    if name in ("semicolons", "tabs", "bars"):
        assert f"labels.csv: its columns are separated by {name}" in "\n".join(recording.notes)


def test_decimal_commas_are_read_between_semicolons(tmp_path: Path) -> None:
    table = write(tmp_path / "set", "image;steering")
    table.write_text(re.sub(r"\.(?=\d)", ",", table.read_text().replace(".jpg,", ".jpg;")))
    check_whole(read(table))
    table.write_text(table.read_text().partition("\n")[2])
    check_whole(read(table, PLACED))


def test_a_header_in_the_middle_is_left_out_and_noted(table: Path) -> None:
    lines = table.read_text().splitlines()
    table.write_text("\n".join([*lines[:30], HEADER, *lines[30:], ""]))
    recording = read(table)
    check_whole(recording)
    assert "labels.csv: row 31 repeats the header" in "\n".join(recording.notes)


def test_two_equal_rows_without_a_header_are_two_rows(tmp_path: Path) -> None:
    table = write(tmp_path / "set", "")
    lines = table.read_text().splitlines()
    table.write_text("\n".join([lines[0], *lines, ""]))
    assert len(read(table, PLACED)) == foreign.ROWS + 1


def test_the_hidden_file_that_a_mac_writes_for_each_is_no_second_table(table: Path) -> None:
    table.with_name("._labels.csv").write_bytes(b"\0\5\x16\7")
    check_whole(read(table.parent))


PATHS = {
    "bare": "{}.jpg",
    "linux": "/content/drive/My Drive/car/IMG/{}.jpg",
    "windows": r"C:\Users\me\car\IMG\{}.jpg",
    "dots": "./IMG/{}.jpg",
    "another folder": "somewhere/{}.jpg",
}


@pytest.mark.parametrize("style", PATHS)
def test_paths_of_another_machine_lead_to_the_images_here(style: str, tmp_path: Path) -> None:
    check_whole(read(write(tmp_path / "set", HEADER, PATHS[style])))


def test_bare_names_are_found_in_one_folder_and_not_in_one_of_two(tmp_path: Path) -> None:
    table = write(tmp_path / "set", HEADER, "{}.jpg")
    (table.parent / "IMG").rename(table.parent / "frames")
    check_whole(read(table))
    foreign.write_frames(table.parent / "test", [f"{row}.jpg" for row in range(foreign.ROWS)])
    with pytest.raises(InputError, match=r"labels\.csv, row 2: no centre image"):
        read(table)


@pytest.mark.parametrize("date", ["2024-05-01T12:00:00.5", "01/05/2024 12:00"])
def test_times_that_are_dates_are_to_be_seconds(date: str, tmp_path: Path) -> None:
    table = write(tmp_path / "set", "image,steering,when", form=f"{{path}},{{turn}},{date}")
    with pytest.raises(InputError, match=r"row 2: when is '.*', not seconds: convert dates"):
        read(table, {"image": "image", "steering": "steering", "time": "when"})


def test_no_window_reaches_over_a_bad_row(table: Path) -> None:
    lines = table.read_text().splitlines()
    lines[11] = "0.jpg,left"
    table.write_text("\n".join([*lines, ""]))
    assert np.flatnonzero(missing_rows(read(table, on_bad_row="skip"))).tolist() == [9]


def test_a_table_in_the_current_folder_has_its_own_images(here: Path) -> None:
    table = write(here, HEADER, "{}.jpg")
    for image in (here / "IMG").iterdir():
        image.rename(here / f"1{image.name}")  # 10.jpg and 110.jpg, of which one is a part
    table.write_text(table.read_text().replace("\n", "\n1"))
    names = [list(map(file_name, read(path).images[:, 0])) for path in (table, Path(table.name))]
    assert names[0] == names[1]


def test_the_path_itself_comes_first(tmp_path: Path) -> None:
    table = write(tmp_path / "set", HEADER, "pics/{}.jpg")
    foreign.write_frames(table.parent / "pics", [f"{row}.jpg" for row in range(foreign.ROWS)])
    assert Path(read(table).images[0, 0]).parent.name == "pics"


@pytest.mark.parametrize("path", ["../other/{}.jpg", r"..\other\{}.jpg", "IMG/../../other/{}.jpg"])
def test_a_path_out_of_the_folder_is_a_bad_row(path: str, tmp_path: Path) -> None:
    foreign.write_frames(tmp_path / "other", [f"{row}.jpg" for row in range(foreign.ROWS)])
    table = write(tmp_path / "set", HEADER, path)
    with pytest.raises(InputError, match=r"labels\.csv, row 2: .* is no path within the folder"):
        read(table)


def test_an_absolute_path_of_this_machine_is_not_followed_out_of_the_folder(tmp_path: Path) -> None:
    foreign.write_frames(tmp_path / "secret", [f"s{row}.jpg" for row in range(foreign.ROWS)])
    table = write(tmp_path / "set", HEADER, f"{tmp_path}/secret/s{{}}.jpg")
    with pytest.raises(InputError, match=r"labels\.csv, row 2: no centre image"):
        read(table)


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        (HEADER, {"image": 5, "steering": 1}, "the header image,1 has no column 5; name"),
        (HEADER, NAMED | {"image": "x"}, "the header image,steering has no column x"),
        ("", NAMED, "a table without a header, of columns 0,1, has no"),
    ],
)
def test_a_missing_column_is_named(header: str, columns: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"labels\.csv, row 1: {words}"):
        read(write(tmp_path / "set", header), columns)


def test_an_image_name_that_is_not_utf_8_makes_a_bad_row_as_in_a_log(table: Path) -> None:
    (table.parent / "IMG/3.jpg").rename(table.parent / "IMG" / os.fsdecode(b"\xe4.jpg"))
    table.write_bytes(table.read_bytes().replace(b"IMG/3.jpg", b"IMG/\xe4.jpg"))
    with pytest.raises(InputError, match=r"labels\.csv, row 5: the image name .* is not UTF-8"):
        read(table)
    skipped = read(table, on_bad_row="skip")
    assert len(skipped.bad_rows) == 1
    assert skipped.fingerprint()


@pytest.mark.parametrize("value", [[0], {"a": 0}, None, True, 0.5])
def test_a_column_is_a_name_or_a_position(value: object, table: Path) -> None:
    with pytest.raises(UsageError, match=r"columns: image: .*name, or its position from 0"):
        read(table, {"image": value, "steering": 1})


@pytest.mark.parametrize(
    ("key", "text", "words"),
    [
        ("columns", "{image:image}", "columns: image:image: .*, with a space"),
        ("steering", "{unit:deg}", "steering: unit:deg: .*, with a space"),
        ("steering", "{unti: deg}", "steering: unti: unexpected"),
    ],
)
def test_a_missing_blank_or_odd_key_is_named(key: str, text: str, words: str, table: Path) -> None:
    with pytest.raises(UsageError, match=words):
        read(table, **{key: text})


def test_a_table_without_named_columns_names_those_that_it_has(tmp_path: Path) -> None:
    words = r'labels\.csv: has the columns image, steering; name its columns, "data\.columns='
    with pytest.raises(UsageError, match=words):
        read(write(tmp_path / "set", HEADER), None)


def test_images_lie_in_a_folder_of_home(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (table.parent / "IMG").rename(table.parents[1] / "IMG")
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(table.parents[1]))
    check_whole(read(table, images="~/IMG"))
