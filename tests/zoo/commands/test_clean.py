"""`drivezoo clean`: only what drivezoo marked, only what was chosen, only with remove=true."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from datamodules.view_store import CACHE
from tests.zoo.command_runs import run_here, succeed
from zoo.base.errors import InputError, UsageError
from zoo.base.new_folder import RECORDINGS, command_folder, hold_folder, whole_folder
from zoo.base.whole_file import write_output, write_whole
from zoo.base.written_files import LOCK, MARK, OUTPUTS, mark_folder, note_files
from zoo.commands.clean import clean
from zoo.runs.status import mark_run, write_status

OWN = {MARK, OUTPUTS, LOCK}


def write(*paths: Path) -> None:
    """Write files as a command does in its folder."""
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, "x" * 1000)


@pytest.fixture
def outputs(tmp_path: Path) -> Path:
    """Write what commands leave: a run, an evaluation, a recording, a cache and a table."""
    folder = tmp_path / "outputs"
    run = folder / "2026-01-02" / "10-11-12-000000"
    (folder / "cache").mkdir(parents=True)
    run.mkdir(parents=True)
    mark_run(run)
    write(run / "checkpoints" / "best.ckpt")
    with command_folder(folder / "evaluations" / "2026-01-03" / "10-11-12", "evaluations") as one:
        write(one / "metrics.json", one / "drives" / "lake-0" / "drive.csv")
    with whole_folder(folder / "recordings" / "lake", RECORDINGS) as one:
        write(one / "driving_log.csv", one / "IMG" / "center.jpg")
    mark_folder(folder / "cache", CACHE)
    write(folder / "cache" / "0123.npy", folder / "cache" / "0123.json")
    write_output(folder / "table.csv", "a,b\n")
    return folder


def left(folder: Path) -> set[str]:
    """Return the files of a folder, but for registers and locks."""
    files = [one for one in folder.rglob("*") if one.is_file() and one.name not in OWN]
    return {one.relative_to(folder).as_posix() for one in files}


def cleaned(folder: Path) -> str:
    """Remove all of a folder that `what=all` removes, and return what is printed."""
    return succeed(
        run_here(folder, str(folder), "what=all", "remove=true", module="zoo.commands.clean")
    )


def test_it_only_lists_if_not_asked_to_remove(outputs: Path, capsys: pytest.CaptureFixture) -> None:
    before = left(outputs)
    clean.main([str(outputs), "what=all"])
    assert left(outputs) == before
    out = capsys.readouterr().out
    assert "nothing was removed" in out
    assert "remove=true" in out
    for kind in ("cache", "runs", "files", "evaluations", "recordings"):
        assert kind in out


def test_it_removes_the_cache_alone_if_nothing_is_named(outputs: Path) -> None:
    before = left(outputs)
    clean.main([str(outputs), "remove=true"])
    assert before - left(outputs) == {"cache/0123.npy", "cache/0123.json"}


def test_all_is_everything_but_recordings(outputs: Path) -> None:
    cleaned(outputs)
    assert left(outputs) == {"recordings/lake/driving_log.csv", "recordings/lake/IMG/center.jpg"}
    assert not (outputs / "evaluations" / "2026-01-03").exists()


def test_a_recording_is_removed_only_by_its_name(outputs: Path) -> None:
    lake = outputs / "recordings" / "lake"
    with pytest.raises(UsageError, match="what=recordings"):
        clean.main([str(outputs), "what=recordings", "remove=true"])
    assert lake.exists()
    clean.main([str(outputs), f"what={lake}", "remove=true"])
    assert not lake.exists()
    assert (outputs / "table.csv").exists()


@pytest.mark.parametrize(
    "name",
    [
        "pics/2024-05-01/10-30-00/wedding.jpg",
        "best_of_2020/2020-01-01/10-00-00x/thesis.tex",
        "drive/2026-01-01/10-00-00/driving_log.csv",
        "sweeps/2026-01-01/10-00-00/0/metrics.json",
        "cache/0123456789abcdef01234567.npy",
        ".lake.0123456789abcdef.part/mine.txt",
    ],
)
def test_a_name_like_one_of_drivezoo_is_no_mark(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    printed = cleaned(tmp_path)
    assert path.read_text() == "mine"
    assert str(tmp_path / name.partition("/")[0]) in printed


def test_the_users_files_in_marked_folders_stay_and_are_listed(outputs: Path) -> None:
    run = outputs / "2026-01-02" / "10-11-12-000000"
    mine = [run / "notes.txt", run / "checkpoints" / "mine.ckpt", outputs / "cache" / "notes.txt"]
    for one in mine:
        one.write_text("mine")
    (run / "link").symlink_to(outputs / "recordings")
    printed = cleaned(outputs)
    assert all(one.read_text() == "mine" for one in mine)
    assert (run / "link").is_symlink()
    assert not (run / "checkpoints" / "best.ckpt").exists()
    assert str(run / "notes.txt") in printed


def test_a_file_that_the_user_changed_stays(outputs: Path) -> None:
    (outputs / "table.csv").write_text("mine")
    cleaned(outputs)
    assert (outputs / "table.csv").read_text() == "mine"


def test_a_register_names_no_file_outside_its_folder(outputs: Path, tmp_path: Path) -> None:
    run = outputs / "2026-01-02" / "10-11-12-000000"
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "mine.txt").write_text("mine")
    (run / "in").symlink_to(tmp_path / "more")
    with (run / MARK).open("a") as file:
        for name in ("../../../mine.txt", str(tmp_path / "mine.txt"), "in/mine.txt"):
            file.write(f'\n{{"file": "{name}"}}')
    cleaned(outputs)
    assert (tmp_path / "mine.txt").exists()
    assert (tmp_path / "more" / "mine.txt").exists()


def test_a_recording_in_another_folder_stays(outputs: Path) -> None:
    with command_folder(outputs / "corrections", "corrections") as folder:
        write(folder / "correct.json", folder / "round-1" / "recording" / "driving_log.csv")
    cleaned(outputs)
    assert (outputs / "corrections" / "round-1" / "recording" / "driving_log.csv").exists()
    assert not (outputs / "corrections" / "correct.json").exists()


def test_a_run_that_trains_and_what_is_new_stay(outputs: Path) -> None:
    first = outputs / "2026-01-02" / "10-11-12-000000"
    second = outputs / "2026-01-02" / "10-11-13-000000"
    second.mkdir()
    mark_run(second)
    write(second / "metrics.json")
    write_status(first, "running")
    old = time.time() - 10 * 86_400
    for one in [*outputs.rglob("*"), outputs]:
        os.utime(one, (old, old))
    clean.main([str(outputs), "what=runs", "older_days=11", "remove=true"])
    assert second.exists()
    clean.main([str(outputs), "what=runs", "older_days=9", "remove=true"])
    assert first.exists()
    assert not second.exists()


HOLD = """
import sys, time
from zoo.base.new_folder import command_folder, whole_folder
from zoo.base.whole_file import write_whole
from pathlib import Path
make = {"command": command_folder, "whole": whole_folder}[sys.argv[1]]
with make(Path(sys.argv[2]), "evaluations") as folder:
    write_whole(folder / "metrics.json", "{}")
    print("ready", flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize("make", ["command", "whole"])
def test_what_a_command_writes_stays_until_it_is_killed(make: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, make, str(tmp_path / "one")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    assert f"in use, stays: {tmp_path}" in cleaned(tmp_path)
    assert left(tmp_path), "it is in use"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    cleaned(tmp_path)
    assert not list(tmp_path.iterdir()), "a dead process's lock is no lock"


def test_a_view_that_is_being_decoded_stays(outputs: Path) -> None:
    from filelock import FileLock

    note_files(outputs / "cache" / "0123.lock")
    with FileLock(outputs / "cache" / "0123.lock"):
        clean.main([str(outputs), "remove=true"])
    assert (outputs / "cache" / "0123.npy").exists()


def test_a_folder_that_is_taken_meanwhile_stays(outputs: Path) -> None:
    folder = outputs / "evaluations" / "2026-01-03" / "10-11-12"
    with hold_folder(folder):
        clean.main([str(outputs), "what=evaluations", "remove=true"])
    assert (folder / "metrics.json").exists()


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        (["nowhere"], InputError, "nowhere: no such folder"),
        (["all"], InputError, "what=all"),
        (["{}", "what=run"], UsageError, "did you mean runs"),
        (["{}", "older_days=-1"], UsageError, "older_days=-1"),
        (["{}", "{}"], UsageError, "no further arguments"),
    ],
)
def test_bad_input_gets_one_line(
    arguments: list[str], kind: type[Exception], words: str, outputs: Path
) -> None:
    before = left(outputs)
    with pytest.raises(kind, match=words):
        clean.main([one.format(outputs) for one in arguments])
    assert left(outputs) == before
