"""Files that are not what their name says: each reader knows them by their contents."""

import io
import zipfile
from pathlib import Path

import pytest

from datamodules.recording_format import read_recordings
from tests.contracts.test_recordings import FORMATS, LOGS, Example
from zoo.base.bounded_files import open_data, read_text
from zoo.base.errors import InputError
from zoo.commands.check import look_at_image


def spreadsheet() -> bytes:
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr("xl/workbook.xml", "x" * 2000)
    return written.getvalue()


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:b9\nsize 489473\n"
KINDS = {
    "pointer": (POINTER, "Git LFS pointer.*git lfs pull"),
    "page": (b"\n<!doctype HTML><html>Not found</html>" + 2000 * b" ", "web page"),
    "sheet": (spreadsheet(), "spreadsheet .*as CSV"),
    "old sheet": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(2000), "spreadsheet .*as CSV"),
    "zip": (b"PK\x03\x04" + bytes(2000), "archive .*unpack"),
    "gzip": (b"\x1f\x8b\x08" + bytes(2000), "archive .*unpack"),
}
FILES = LOGS | {"donkeycar": "manifest.json"}  # a file of each format that its reader opens


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_kind_is_named_by_contents(name: str, kind: str, tmp_path: Path) -> None:
    check_another_kind(name, FORMATS[name], FILES[name], kind, tmp_path)


def check_another_kind(name: str, example: Example, file: str, kind: str, tmp_path: Path) -> None:
    write, _, _, options = example
    folder = write(tmp_path / "recording")
    data, words = KINDS[kind]
    (folder / file).write_bytes(data)
    with pytest.raises(InputError, match=rf"{Path(file).name}\b.*: .*{words}"):
        read_recordings(str(folder), **{"format": name, **options}, on_bad_row="skip")


@pytest.mark.parametrize("kind", KINDS)
def test_an_image_of_another_kind_is_named_by_its_contents(kind: str, tmp_path: Path) -> None:
    data, words = KINDS[kind]
    image = tmp_path / "center_1.jpg"
    image.write_bytes(data)
    assert words.partition(" ")[0].partition(".")[0] in str(look_at_image(str(image)))


def test_small_files_of_no_such_kind_are_read_from_their_first_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    for text in ("", "v", "version 1", "PK", "BMW,1", "{}" + " " * 2000):
        path.write_text(text)
        assert read_text(path, 10_000) == text
        with open_data(path, 10_000) as file:
            assert file.read() == text.encode()
