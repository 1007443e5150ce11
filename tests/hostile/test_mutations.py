"""The strategies damage what they are given, and the check notices a reader that fails."""

import json
from pathlib import Path

import pytest

from tests.hostile.mutations import mutated_bytes, read_damaged
from zoo.base.errors import InputError


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
