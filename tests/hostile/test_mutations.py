"""The strategies damage what they are given, and the check notices a reader that fails."""

import io
import json
import zipfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.hostile.mutations import mutated_bytes, mutated_json, mutated_zip, read_damaged
from zoo.base.bounded_files import read_json
from zoo.base.errors import InputError


def archive(**members: bytes) -> bytes:
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w") as file:
        for name, contents in members.items():
            file.writestr(name, contents)
    return written.getvalue()


@settings(max_examples=30)
@given(st.data())
def test_an_archive_stays_an_archive(data: st.DataObject) -> None:
    changed = data.draw(mutated_zip(archive(a=b"1", b=b"22"), {"b": st.just(b"333")}))
    with zipfile.ZipFile(io.BytesIO(changed)) as file:
        assert len(file.namelist()) in (1, 2, 3)


def test_a_reader_that_names_damaged_files_passes(tmp_path: Path) -> None:
    damaged = mutated_json({"a": [1, {"b": "x"}], "c": None})
    read_damaged(damaged, read_json, tmp_path / "a.json", 50)


def parse(path: Path) -> object:
    return json.loads(path.read_bytes())


def refuse(path: Path) -> None:
    raise InputError("something is wrong")


@pytest.mark.parametrize(("read", "error"), [(parse, ValueError), (refuse, AssertionError)])
def test_a_reader_that_raises_another_error_or_names_no_file_fails(
    read: object, error: type[Exception], tmp_path: Path
) -> None:
    with pytest.raises(error):
        read_damaged(mutated_bytes(b'{"a": [1]}'), read, tmp_path / "a.json", 50)
