"""Files and folders that commands write: whole, marked, and held by one process."""

import os
from contextlib import suppress
from pathlib import Path

import pytest

from zoo.base import whole_file
from zoo.base.errors import InputError
from zoo.base.new_folder import (
    command_folder,
    is_held,
    whole_folder,
)
from zoo.base.whole_file import write_new, write_output, write_whole
from zoo.base.written_files import MARK, OUTPUTS, check_output, mark_folder, read_register


def test_only_a_file_that_drivezoo_wrote_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "table.tex"
    path.write_text("mine")
    with pytest.raises(InputError, match=r"table=.*table\.tex: exists, and drivezoo did not"):
        write_output(path, "its", "table")
    assert path.read_text() == "mine"
    path.unlink()
    write_output(path, "its", "table")
    write_output(path, "its second", "table")
    assert path.read_text() == "its second"


def test_a_file_that_was_changed_is_the_users(tmp_path: Path) -> None:
    path = write_output(tmp_path / "table.tex", "its")
    path.write_text("mine")
    with pytest.raises(InputError, match="was changed after drivezoo wrote it"):
        check_output(path)


def test_a_moved_folder_keeps_what_is_known_of_its_files(tmp_path: Path) -> None:
    (tmp_path / "before").mkdir()
    write_output(tmp_path / "before" / "table.tex", "its")
    (tmp_path / "before").rename(tmp_path / "after")
    check_output(tmp_path / "after" / "table.tex")


def test_an_input_is_not_replaced(tmp_path: Path) -> None:
    path = write_output(tmp_path / "a.json", "{}")
    os.link(path, tmp_path / "b.json")
    for one in (path, tmp_path / "b.json"):
        with pytest.raises(InputError, match=r"out=.*\.json: is an input of this command"):
            check_output(one, inputs=[path])


def test_a_file_of_a_commands_results_is_no_output(tmp_path: Path) -> None:
    with command_folder(tmp_path / "r1", "benchmarks") as folder:
        write_whole(folder / "result.json", "{}")
    with pytest.raises(InputError, match=r"belongs to the results in .*r1"):
        check_output(folder / "result.json")
    write_output(folder / "compare.json", "{}")
    check_output(folder / "compare.json")
    assert not (folder / OUTPUTS).exists(), "a marked folder has one register"


@pytest.mark.skipif(os.name != "posix", reason="makes links and a named pipe")
@pytest.mark.parametrize("kind", ["link", "broken link", "pipe", "folder"])
def test_what_is_no_file_is_refused_without_waiting(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    (tmp_path / "secret.txt").write_text("mine")
    {
        "link": lambda: path.symlink_to("secret.txt"),
        "broken link": lambda: path.symlink_to("nowhere"),
        "pipe": lambda: os.mkfifo(path),
        "folder": path.mkdir,
    }[kind]()
    with pytest.raises(InputError, match=r"out=.*out\.csv"):
        write_output(path, "its")
    assert (tmp_path / "secret.txt").read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.skipif(os.name != "posix", reason="makes a link")
@pytest.mark.parametrize("name", [OUTPUTS, MARK])
def test_a_link_in_place_of_the_register_is_not_followed(name: str, tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text("mine")
    (tmp_path / name).symlink_to("secret.txt")
    with suppress(InputError):
        write_output(tmp_path / "out.csv", "its")
    assert (tmp_path / "secret.txt").read_text() == "mine"


def test_a_damaged_register_knows_its_whole_lines(tmp_path: Path) -> None:
    mark_folder(tmp_path, "runs")
    with (tmp_path / MARK).open("ab") as file:
        file.write(b'\n{"file": "a')  # by a full disk
    write_whole(tmp_path / "b", "")
    with (tmp_path / MARK).open("ab") as file:
        file.write(b'\n\xff\n[]\n{"file": 3}\n{"file": "/etc/passwd"}\n{"file": "../c"}')
    found = read_register(tmp_path / MARK)
    assert found.kind == "runs"
    assert [one for one in found.files if not one.startswith(".")] == ["b"]


@pytest.mark.parametrize("small_disk", ["16k"], indirect=True)
def test_a_full_disk_keeps_the_file_before(small_disk: Path) -> None:
    path = write_output(small_disk / "out.csv", "before")
    with pytest.raises(InputError, match=r"out=.*out\.csv: No space left"):
        write_output(path, "x" * 20_000)
    assert path.read_text() == "before"
    assert not list(small_disk.glob("*.part"))


def test_a_new_file_replaces_none(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("mine")
    with pytest.raises(FileExistsError):
        write_new(tmp_path / "a", b"its")
    assert (tmp_path / "a").read_text() == "mine"


def open_for(monkeypatch: pytest.MonkeyPatch, tries: int) -> None:
    """Let replacing fail as on Windows, while another program has the file open."""
    refused = [PermissionError(13, "Access is denied")] * tries
    replace = Path.replace

    def try_to_replace(self: Path, target: Path) -> Path:
        if refused:
            raise refused.pop()
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", try_to_replace)
    monkeypatch.setattr(whole_file, "OPEN_FILES_STAY", True)
    monkeypatch.setattr(whole_file, "RETRY_S", 0.001)


def test_a_file_that_is_closed_in_time_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_whole(tmp_path / "a.txt", "old")
    open_for(monkeypatch, tries=3)
    assert write_whole(path, "new").read_text() == "new"


def test_a_file_that_stays_open_is_named_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_whole(tmp_path / "a.txt", "old")
    open_for(monkeypatch, tries=10_000)
    monkeypatch.setattr(whole_file, "REPLACE_S", 0.01)
    with pytest.raises(OSError, match=r"open in another program; close it.*a\.txt"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert not list(tmp_path.glob(".a.txt.*"))


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
