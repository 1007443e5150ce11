"""What a recording says of its own size is compared with what was read, both ways."""

import shutil
from pathlib import Path

import pytest

from datamodules.recording_format import read_recordings
from tests import foreign_recordings as foreign
from tests.datamodules.test_path_contents import tub
from tests.recordings import replace_in, write_recording
from zoo.base.errors import InputError


def notes(folder: Path, **options: object) -> str:
    return "\n".join(read_recordings(str(folder), **options).notes)


def test_images_that_no_record_names_are_counted(tmp_path: Path) -> None:
    folder = tub(tmp_path / "tub", rows=2)
    assert f"4 images in {folder}/images have no row" in notes(folder)


@pytest.mark.parametrize("deleted", ["[3, 4]", '["3", "4"]', "[3.0, 4.0]", '"3, 4"', '"[3, 4]"'])
def test_deleted_records_are_left_out_and_images_have_a_row(deleted: str, tmp_path: Path) -> None:
    folder = tub(tmp_path / "tub", rows=6)
    replace_in(folder / "manifest.json", "[]}", f"{deleted}}}")
    assert read_recordings(str(folder)).steering == pytest.approx([0.0, 0.01, 0.02, 0.05])
    printed = notes(folder)
    assert "2 records left out" in printed
    assert "have no row" not in printed


@pytest.mark.parametrize("deleted", ['["3-7"]', "[true]", "[null]", "[-1]", '["x"]', "[[3]]"])
def test_what_is_no_deleted_record_is_refused(deleted: str, tmp_path: Path) -> None:
    folder = tub(tmp_path / "tub")
    replace_in(folder / "manifest.json", "[]}", f"{deleted}}}")
    with pytest.raises(InputError, match=r"manifest\.json, row 5: deleted_indexes has .*; correct"):
        read_recordings(str(folder))


def test_a_catalog_that_the_manifest_does_not_name_is_counted(tmp_path: Path) -> None:
    folder = tub(tmp_path / "tub", rows=4)
    shutil.copy(folder / "catalog_0.catalog", folder / "catalog_15.catalog")
    (folder / "._catalog_0.catalog").write_bytes(b"\0\5\x16\7")
    assert ": catalog_15.catalog: left out, since manifest.json does not name it" in notes(folder)


@pytest.mark.parametrize("counted", [9, 3])
def test_a_manifest_that_counts_other_records_is_named(counted: int, tmp_path: Path) -> None:
    folder = tub(tmp_path / "tub", rows=4)
    replace_in(folder / "manifest.json", '"current_index": 4', f'"current_index": {counted}')
    assert f"manifest.json counts {counted} records, and its catalogs hold 4" in notes(folder)


def test_a_tub_without_its_manifest_is_read_in_the_order_of_its_catalogs(tmp_path: Path) -> None:
    folder = tub(tmp_path / "tub", rows=3)
    lines = (folder / "catalog_0.catalog").read_text().splitlines(keepends=True)
    for number, line in zip((0, 2, 10), lines, strict=True):
        (folder / f"catalog_{number}.catalog").write_text(line)
    (folder / "manifest.json").unlink()
    assert read_recordings(str(folder)).steering == pytest.approx([0.0, 0.01, 0.02])
    words = "no manifest.json: deleted records are read, too, of catalog_0.catalog, catalog_2"
    assert words in notes(folder)


@pytest.mark.parametrize("rows", [1, 4])
def test_images_beside_a_log_that_no_row_names_are_counted(rows: int, tmp_path: Path) -> None:
    written = write_recording(tmp_path / "lake", rows=4)
    written.log.write_text("".join(written.log.read_text().splitlines(keepends=True)[:rows]))
    note = f"{written.folder}: {3 * (4 - rows)} images in {written.folder}/IMG have no row"
    assert notes(written.folder) == ("" if rows == 4 else note)


def test_images_of_bad_rows_have_a_row(tmp_path: Path) -> None:
    written = write_recording(tmp_path / "lake", rows=4)
    lines = written.log.read_text().splitlines(keepends=True)
    written.log.write_text("".join([*lines[:3], lines[3].replace(",0", ",x", 1)[:-5] + "x\n"]))
    recording = read_recordings(str(written.folder), on_bad_row="skip")
    assert (len(recording), len(recording.bad_rows), recording.notes) == (3, 1, ())


def test_an_image_beside_other_formats_that_no_row_names_is_counted(tmp_path: Path) -> None:
    check_an_unnamed_image(foreign.challenge2_training(tmp_path / "recording"))


def check_an_unnamed_image(folder: Path) -> None:
    assert "have no row" not in notes(folder)
    image = sorted(path for path in folder.rglob("*.jpg") if "left" not in str(path))[0]
    shutil.copy(image, image.with_name("extra.jpg"))
    assert f"1 images in {image.parent} have no row" in notes(folder)
