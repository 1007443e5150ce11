"""Files and folders that commands write: whole, never over a user's, held by one process."""

import os
from pathlib import Path

import pytest

from zoo.base import whole_file
from zoo.base.errors import InputError, UsageError
from zoo.base.new_folder import command_folder, is_held, whole_folder
from zoo.base.output_files import check_output, overwriting
from zoo.base.whole_file import write_new, write_output, write_whole


def test_a_file_that_exists_is_replaced_only_with_overwrite(tmp_path: Path) -> None:
    path = tmp_path / "table.tex"
    path.write_text("mine")
    with pytest.raises(UsageError, match=r"table=.*table\.tex: exists; .*overwrite=true"):
        write_output(path, "its", "table")
    assert path.read_text() == "mine"
    with overwriting(True):
        write_output(path, "its", "table")
    assert path.read_text() == "its"
    with pytest.raises(UsageError, match=r"table\.tex: exists"):
        write_output(path, "its second", "table")


def test_a_default_name_is_replaced_below_outputs_alone(here: Path) -> None:
    for folder in ("outputs/preview", "site"):
        Path(folder).mkdir(parents=True)
    Path("outputs/site").symlink_to(here / "site")
    write_output(Path("outputs/preview/a.png"), "first", key="")
    write_output(Path("outputs/preview/a.png"), "second", key="")
    assert Path("outputs/preview/a.png").read_text() == "second"
    with pytest.raises(UsageError, match=r"out=.*a\.png: exists"):
        write_output(Path("outputs/preview/a.png"), "third")
    Path("site/a.png").write_text("mine")
    for name in ("site/a.png", "outputs/../site/a.png", "outputs/site/a.png"):
        with pytest.raises(UsageError, match=r"a\.png: exists"):
            write_output(Path(name), "its", key="")


@pytest.mark.skipif(os.name != "posix", reason="makes links")
def test_an_input_is_never_replaced(tmp_path: Path) -> None:
    path = write_output(tmp_path / "a.json", "{}")
    os.link(path, tmp_path / "b.json")
    (tmp_path / "c.json").symlink_to(path)
    (tmp_path / "linked").symlink_to(tmp_path)
    for name in ("a.json", "b.json", "c.json", "linked/a.json"):
        with (
            overwriting(True),
            pytest.raises(InputError, match=r"out=.*\.json: is an input of this command"),
        ):
            check_output(tmp_path / name, inputs=[path])


def test_a_file_in_a_folder_that_is_read_is_an_input(tmp_path: Path) -> None:
    log = tmp_path / "lake" / "driving_log.csv"
    log.parent.mkdir()
    log.write_text("mine")
    with overwriting(True), pytest.raises(InputError, match="is an input of this command"):
        check_output(log, "table", inputs=[tmp_path / "lake"])
    check_output(tmp_path / "lake" / "new.csv", "table", inputs=[tmp_path / "lake"])


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
    with overwriting(True), pytest.raises(InputError, match=r"out=.*out\.csv"):
        write_output(path, "its")
    assert (tmp_path / "secret.txt").read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize("small_disk", ["16k"], indirect=True)
def test_a_full_disk_keeps_the_file_before(small_disk: Path) -> None:
    path = write_output(small_disk / "out.csv", "before")
    with overwriting(True), pytest.raises(InputError, match=r"out=.*out\.csv: No space left"):
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


def test_a_file_closed_in_time_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_whole(tmp_path / "a.txt", "old")
    open_for(monkeypatch, tries=3)
    assert write_whole(path, "new").read_text() == "new"


def test_a_folder_scanned_for_a_moment_is_not_lost(tmp_path: Path, monkeypatch) -> None:
    open_for(monkeypatch, tries=3)
    with whole_folder(tmp_path / "lake") as part:
        (part / "1.jpg").touch()
    assert (tmp_path / "lake" / "1.jpg").exists()


@pytest.mark.parametrize(
    ("writable", "reason"), [(True, "open in another program; close it"), (False, "is denied")]
)
def test_a_file_that_stays_open_is_named(
    writable: bool, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_whole(tmp_path / "a.txt", "old")
    open_for(monkeypatch, tries=10_000)
    monkeypatch.setattr(whole_file, "REPLACE_S", 0.01)
    monkeypatch.setattr("os.access", lambda *_: writable)
    with pytest.raises(OSError, match=rf"{reason}.*a\.txt"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert not list(tmp_path.glob(".a.txt.*"))


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


def test_a_whole_folder_appears_when_it_is_complete(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "lake") as folder:
        (folder / "a.jpg").write_text("")
        assert not (tmp_path / "lake").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["lake"]
    assert [path.name for path in (tmp_path / "lake").iterdir()] == ["a.jpg"]


def test_a_folder_with_the_mark_of_an_earlier_version_is_empty(tmp_path: Path) -> None:
    (tmp_path / ".drivezoo.jsonl").write_text("")
    with command_folder(tmp_path, "evaluations") as folder:
        assert folder == tmp_path
