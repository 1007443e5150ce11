"""Paths that are no recording: the message names what lies there, and what to type."""

import json
import shutil
import unicodedata
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from datamodules.recording_format import read_recordings
from tests import foreign_recordings as foreign
from tests.recordings import write_recording
from tests.refusals import refusal
from tests.zoo.command_runs import only_line, run_here, succeed
from zoo.base.errors import InputError


def refusal_of(path: Path) -> str:
    """Return the words after the path with which a path is refused."""
    message = refusal(read_recordings, str(path))
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def tub(folder: Path, rows: int = 3, images: int = 6) -> Path:
    (folder / "images").mkdir(parents=True)
    for row, frame in enumerate(foreign.frames()[:images]):
        cv2.imwrite(str(folder / f"images/{row}.jpg"), frame)
    records = [{"cam/image_array": f"{row}.jpg", "user/angle": row / 100} for row in range(rows)]
    catalogs = {"paths": ["catalog_0.catalog"], "current_index": rows, "deleted_indexes": []}
    manifest = [["cam/image_array"], ["image_array"], {}, {}, catalogs]
    for name, lines in (("catalog_0.catalog", records), ("manifest.json", manifest)):
        (folder / name).write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return folder


WRITERS: dict[str, Callable[[Path], object]] = {
    "log": lambda folder: write_recording(folder, rows=1),
    "tub": tub,
    "challenge2": foreign.challenge2_test,
}


@pytest.mark.parametrize("deep", ["data", "data/data", "a/b/c"])
@pytest.mark.parametrize("name", WRITERS)
def test_a_recording_below_is_named(name: str, deep: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / "my [1] car" / deep)
    message = refusal_of(tmp_path / "my [1] car")
    assert message.startswith("holds no driving_log.csv")
    assert message.endswith(f"name {tmp_path}/my [1] car/{deep}")


def test_of_several_recordings_three_are_named_and_hidden_folders_are_not(tmp_path: Path) -> None:
    for name in "abcd":
        write_recording(tmp_path / name, rows=1)
    for name in (".trash", "__MACOSX"):
        tub(tmp_path / name)
    message = refusal_of(tmp_path)
    assert "4 recordings lie below" in message
    assert message.endswith(f"name {tmp_path}/a, or {tmp_path}/b, or {tmp_path}/c")


def test_an_empty_tub_names_the_tubs_in_it(tmp_path: Path) -> None:
    tub(tmp_path / "data", rows=0)
    message = refusal_of(tmp_path / "data")
    assert "deleted" not in message
    assert "has no records" in message
    tub(tmp_path / "data" / "tub_1_24-01-01")
    assert refusal_of(tmp_path / "data").endswith(f"name {tmp_path}/data/tub_1_24-01-01")


@pytest.mark.parametrize("part", ["images", "images/3.jpg", "manifest.json", "catalog_0.catalog"])
def test_a_part_of_a_recording_names_the_whole(part: str, tmp_path: Path) -> None:
    folder = tub(tmp_path / "tub")
    assert refusal_of(folder / part).endswith(f"name {folder}")


def test_the_table_of_a_format_names_its_folder(tmp_path: Path) -> None:
    folder = foreign.challenge2_training(tmp_path / "drive")
    assert refusal_of(folder / "interpolated.csv").endswith(f"name {folder}")


@pytest.mark.parametrize(
    "name", ["Driving_Log.csv", "DRIVING_LOG.CSV", "driving_log (1).csv", "driving_log.csv.txt"]
)
def test_a_log_of_nearly_the_right_name_is_named(name: str, tmp_path: Path) -> None:
    write_recording(tmp_path / "lake", rows=1).log.rename(tmp_path / "lake" / name)
    message = refusal_of(tmp_path / "lake")
    assert name in message
    assert "rename" in message


TABLES = {
    "image,steering\nIMG/1.jpg,0.1\n": "image: image, steering: steering",
    "filename;angle;speed\n1.png;0,1;3\n": "image: filename, steering: angle",
    "t\tframe_path\tsteer_cmd\n0\tx\t0.1\n": "image: frame_path, steering: steer_cmd",
    "IMG/1.jpg,0.1\nIMG/2.jpg,0.2\n": "image: 0, steering: 1",
    "0.1|IMG/1.jpg\n": "image: 1, steering: 0",
    "IMG/1.jpg,0.1,0.5\n": "image: 0, steering: NAME",
    ",image,steering\n0,IMG/1.jpg,0.1\n": "image: image, steering: steering",
}


@pytest.mark.parametrize("text", TABLES)
@pytest.mark.parametrize("kind", ["folder", "file"])
def test_a_table_has_the_command_that_reads_it(text: str, kind: str, tmp_path: Path) -> None:
    file = tmp_path / "labels.csv"
    file.write_text(text)
    message = refusal_of(tmp_path if kind == "folder" else file)
    assert f"type drivezoo check {file} format=table 'columns={{{TABLES[text]}}}'" in message


def test_the_command_of_a_table_reads_it(here: Path) -> None:
    table = foreign.table(here / "set") / "my.csv"
    table.write_text(table.read_text().replace("path,turn", "path,steering"))
    line = only_line(run_here(here, "set", module="zoo.commands.check"))
    words = line.partition("type drivezoo check ")[2].partition(" (keys")[0]
    file, how, columns = words.split(" ", 2)
    succeed(run_here(here, file, how, columns.strip("'"), module="zoo.commands.check"))


def test_a_log_under_another_name_has_its_formats_key(tmp_path: Path) -> None:
    other = write_recording(tmp_path / "lake", rows=3).log.rename(tmp_path / "lake" / "lap_one.csv")
    assert f"type drivezoo check {other} format=udacity" in refusal_of(tmp_path / "lake")
    assert len(read_recordings(str(other), format="udacity")) == 3


def test_a_parquet_table_in_a_folder_has_its_command(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = {"img": pa.array([b"x"], pa.large_binary()), "steering": [0.1]}
    pq.write_table(pa.table(columns), tmp_path / "rows.parquet")
    message = refusal_of(tmp_path)
    assert "rows.parquet format=table 'columns={image: img, steering: steering}'" in message


def test_tables_of_a_rosbag_are_named_with_their_columns(tmp_path: Path) -> None:
    (tmp_path / "camera.csv").write_text("time,filename\n1,a.jpg\n")
    (tmp_path / "steering.csv").write_text("time,angle\n1,0.1\n")
    for words in ("camera.csv has the columns time, filename", "steering.csv has", "join"):
        assert words in refusal_of(tmp_path)


def packed(folder: Path, name: str) -> Path:
    """Write an archive of a tub, alone in a folder."""
    kind = "zip" if name.lower().endswith(".zip") else "gztar" if "gz" in name else "tar"
    archive = shutil.make_archive(str(folder / "archive"), kind, tub(folder / "source"))
    shutil.rmtree(folder / "source")
    (folder / "in").mkdir()
    return Path(archive).rename(folder / "in" / name)


@pytest.mark.parametrize("name", ["tub.zip", "tub.tar.gz", "tub.tgz", "tub.tar", "TUB.ZIP"])
@pytest.mark.parametrize("kind", ["folder", "file"])
def test_an_archive_has_the_command_that_unpacks_it(name: str, kind: str, tmp_path: Path) -> None:
    path = packed(tmp_path, name)
    command = f"python -m zipfile -e {path} {path.parent}/{path.stem}"
    if not name.lower().endswith("zip"):
        command = f"tar -xf {path} -C {path.parent}"
    assert refusal_of(path if kind == "file" else path.parent).endswith(f"type {command}")


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, "no files"),
        ({"a.mp4": b"x"}, "1 .mp4; .*table of their steering"),
        ({"a.jpg": b"x", "b.jpg": b"x"}, "2 .jpg; .*table of their steering"),
        ({"labels.xlsx": b"PK\x03\x04" + bytes(26) + b"xl/workbook.xml"}, "labels.xlsx.*as CSV"),
        ({"data/chunk-000/file-000.parquet": b"PAR1"}, "LeRobot.*meta/info.json"),
        ({"labels.csv": b"<!DOCTYPE html>"}, "labels.csv: is a web page"),
    ],
)
def test_what_a_folder_holds_is_named(files: dict[str, bytes], words: str, tmp_path: Path) -> None:
    for name, data in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    with pytest.raises(InputError, match=words):
        read_recordings(str(tmp_path))


def test_an_address_is_no_folder_with_a_typo() -> None:
    with pytest.raises(InputError, match=r"addresses .*download"):
        read_recordings("https://example.org/recordings/lake")


@pytest.mark.parametrize("name", WRITERS)
def test_a_typo_names_the_nearest_recording_of_any_format(name: str, tmp_path: Path) -> None:
    WRITERS[name](tmp_path / "my_recording")
    assert refusal_of(tmp_path / "my_recoding").endswith(f"name {tmp_path}/my_recording")


def test_a_web_page_beside_a_log_does_not_hide_it(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "lake", rows=2)
    (written.folder / "data.txt").write_text("<html></html>")
    assert len(read_recordings(str(written.folder))) == 2


COMPOSED, DECOMPOSED = (unicodedata.normalize(form, "Bäume_1.jpg") for form in ("NFC", "NFD"))
# Images whose names differ in case or in Unicode's form, as other systems and tools write them.
SPELLINGS = {
    "case": ("Frame_1.JPG", "frame_1.jpg"),
    "suffix": ("1.jpg", "1.JPG"),
    "composed": (COMPOSED, DECOMPOSED),
    "decomposed": (DECOMPOSED, COMPOSED),
}


@pytest.mark.parametrize("kind", ["log", "table", "tub"])
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_an_image_is_found_by_another_spelling(kind: str, spelling: str, tmp_path: Path) -> None:
    written, there = SPELLINGS[spelling]
    images, options = tmp_path / ("images" if kind == "tub" else "IMG"), {}
    images.mkdir()
    cv2.imwrite(str(images / there), foreign.frames()[1])
    if kind == "log":
        (tmp_path / "driving_log.csv").write_text(f"IMG/{written},,,0.1,0,0,1\n")
    elif kind == "table":
        (tmp_path / "labels.csv").write_text(f"image,steering\nIMG/{written},0.1\n")
        options = {"format": "table", "columns": {"image": "image", "steering": "steering"}}
        options |= {"steering": {"unit": "share", "full": 1}}
    else:
        record = {"cam/image_array": written, "user/angle": 0.1}
        (tmp_path / "catalog_0.catalog").write_text(json.dumps(record) + "\n")
    assert Path(read_recordings(str(tmp_path), **options).images[0, 0]).name == there
