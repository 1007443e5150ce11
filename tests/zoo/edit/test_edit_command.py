"""`drivezoo edit`: writes at once, or serves a page until Ctrl-C."""

import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from datamodules.recording_format import read_recordings
from tests.recordings import Written
from tests.zoo.commands import command, environment, only_line, run
from zoo.base.errors import InputError
from zoo.edit.edit_page import PageServer


def test_without_a_page_it_writes_at_once(recorded: Written, tmp_path: Path) -> None:
    options = ("drop=11-20,101-", "split=51", "out=new", "page=false")
    result = run(tmp_path, str(recorded.folder), *options, module="zoo.edit")
    assert result.returncode == 0, result.stderr
    folders = [str(tmp_path / "new" / name) for name in ("1", "2")]
    for folder in folders:
        assert f"wrote: {folder}" in result.stdout
    assert f"next: drivezoo check {folders[0]} {folders[1]}" in result.stdout
    assert len(read_recordings(folders)) == 90


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("drop=0-5",), ("drop=0-5", "1..120")),
        (("keep=many",), ("keep=many", "FIRST-LAST")),
        (("split=121",), ("split=121", "2..120")),
        (("out=.",), ("out=.", "another folder")),
        (("ckpt=no.ckpt",), ("no.ckpt", "no such checkpoint")),
    ],
)
def test_a_wrong_option_is_named(
    recorded: Written, tmp_path: Path, options: tuple[str, ...], words: tuple[str, str]
) -> None:
    line = only_line(run(tmp_path, str(recorded.folder), *options, module="zoo.edit"))
    assert all(word in line for word in words), line


def test_ctrl_c_ends_the_page_and_prints_how_to_resume(recorded: Written, tmp_path: Path) -> None:
    folder = shutil.copytree(recorded.folder, tmp_path / "my lap")
    (folder / "IMG" / recorded.image(4).name).unlink()
    with subprocess.Popen(
        command("zoo.edit", str(folder), "drop=11-20", "port=0"),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment(),
    ) as process:
        lines = [process.stdout.readline() for _ in range(3)]
        assert "skipped 1 row" in lines[1]
        assert "open http://127.0.0.1:" in lines[2]
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=20)
    assert process.returncode == 0, rest
    assert f"next: drivezoo edit '{folder}' drop=11-20" in rest
    assert "Traceback" not in rest


def test_a_port_in_use_is_named_with_its_holder() -> None:
    with (
        PageServer(0, lambda *_: []) as first,
        pytest.raises(InputError, match=rf"port={first.server_port}: held by .*port=0"),
    ):
        PageServer(first.server_port, lambda *_: [])
