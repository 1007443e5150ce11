"""The folders that commands write: empty at first, marked, and held by one process."""

from pathlib import Path

import pytest

from zoo.base.errors import InputError
from zoo.base.new_folder import (
    command_folder,
    is_held,
    whole_folder,
)
from zoo.base.written_files import MARK, read_register


def test_a_folder_that_is_not_empty_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with (
        pytest.raises(InputError, match="is not empty; name another folder with out="),
        command_folder(tmp_path, "evaluations"),
    ):
        pass
    assert [one.name for one in tmp_path.iterdir()] == ["mine.txt"]


def test_a_folder_with_the_file_to_resume_need_not_be_empty(tmp_path: Path) -> None:
    for name in ("unfinished.jsonl", "notes.txt"):
        (tmp_path / name).write_text("")
    with command_folder(tmp_path, "benchmarks", resumed_by="unfinished.jsonl") as folder:
        assert is_held(folder)
    assert not is_held(tmp_path)


def test_two_commands_do_not_write_into_one_folder(tmp_path: Path) -> None:
    with (
        command_folder(tmp_path / "one", "evaluations"),
        pytest.raises(InputError, match=r"another process writes there; .* out="),
        command_folder(tmp_path / "one", "evaluations"),
    ):
        pass


def test_a_command_that_writes_nothing_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyError), command_folder(tmp_path / "a" / "b", "evaluations"):
        raise KeyError
    assert not list(tmp_path.iterdir())


def test_a_whole_folder_knows_all_its_files(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "lake", "recordings") as folder:
        (folder / "IMG").mkdir()
        (folder / "IMG" / "a.jpg").write_text("")
    found = read_register(tmp_path / "lake" / MARK)
    assert (found.kind, list(found.files)) == ("recordings", ["IMG/a.jpg"])
    assert [one.name for one in tmp_path.iterdir()] == ["lake"]
