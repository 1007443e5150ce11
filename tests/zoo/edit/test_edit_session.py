"""A session of the editor, its command, and the analysis of frames in the background."""

import runpy
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

from datamodules.image import StoredImage
from datamodules.recording_edits import Edits
from datamodules.recording_format import read_recordings
from tests.recordings import Written
from tests.zoo.base.test_process_pool import wait_until
from tests.zoo.command_runs import ROOT, only_line, run_here, start, succeed
from zoo.base.errors import InputError
from zoo.base.page_server import PageServer
from zoo.checkpoints.policy_base import Command, Policy
from zoo.server.edit_session import EditSession, FrameAnalysis


def session_of(recorded: Written, out: Path | None = None) -> EditSession:
    recording = read_recordings(str(recorded.folder))
    return EditSession(recording, Edits(len(recording)), out)


def test_undo_and_redo_go_through_all_edits(recorded: Written) -> None:
    session = session_of(recorded)
    session.change("drop", (10, 20))
    session.change("drop", (12, 15))  # nothing changes
    session.change("mirror", (30, 40))
    assert session.state()["undo"] == 2
    session.change("undo", True)
    assert (session.state()["dropped"], session.state()["mirrored"]) == (((10, 20),), ())
    session.change("undo", True)
    session.change("undo", True)  # no step is left
    assert (session.state()["dropped"], session.state()["redo"]) == ((), 2)
    session.change("redo", True)
    session.change("redo", True)
    assert session.options() == ["drop=11-20", "mirror=31-40"]
    session.change("undo", True)
    session.change("split", 60)
    assert session.state()["redo"] == 0, "a new edit ends what could be redone"


def test_edits_are_saved_once_they_are_written(recorded: Written, tmp_path: Path) -> None:
    session = session_of(recorded, tmp_path / "new")
    assert not session.unsaved
    session.change("trim", (10, 20))
    assert session.unsaved
    assert session.start_writing()
    session.finish()
    state = session.state()
    assert (state["finished"], state["failure"], state["writing"]) == (1, "", None)
    assert state["written"]["rows"] == (10,)
    assert not session.unsaved


def test_a_failure_in_the_background_is_kept_for_the_page(recorded: Written) -> None:
    session = session_of(recorded)
    session.change("drop", (0, 120))
    session.start_writing()
    session.finish()
    assert "restore" in session.state()["failure"]


class Counting(Policy):
    """A policy with a memory: it steers by the number of frames since its last reset."""

    def __init__(self) -> None:
        self.frames = 0

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        self.frames += 1
        return Command(self.frames / 1000)

    def reset(self) -> None:
        self.frames = 0


def test_a_video_that_is_damaged_within_does_not_end_the_analysis(recorded: Written) -> None:
    def reader(file: str, number: int) -> np.ndarray:
        raise InputError(f"{file}: damaged")

    recording = read_recordings(str(recorded.folder))
    recording.images[5:, 0] = [StoredImage("v.mp4", at, reader) for at in range(5, len(recording))]
    analysis = FrameAnalysis(recording)
    analysis._analyse()
    assert analysis.done == len(recording)


def test_every_row_is_analysed_in_order_by_a_policy_with_memory(recorded: Written) -> None:
    recording = read_recordings(str(recorded.folder))
    analysis = FrameAnalysis(recording, Counting())
    analysis.start()
    wait_until(lambda: analysis.done == len(recording))
    analysis.stop()
    rows, predicted = analysis.predicted_after(20)
    assert rows.tolist() == list(range(20, len(recording)))
    np.testing.assert_allclose(predicted, np.arange(20, len(recording)) / 1000 + 0.001)
    assert np.isfinite(analysis._differences[1:]).all()


def test_without_a_page_it_writes_at_once(recorded: Written, tmp_path: Path) -> None:
    words = (str(recorded.folder), "drop=11-20,101-", "split=51", "out=new", "page=false")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.edit"))
    for name in ("1", "2"):
        assert f"wrote: new/{name}\n" in printed
    assert "next: drivezoo check new/1 new/2\n" in printed
    assert len(read_recordings([tmp_path / "new" / name for name in ("1", "2")])) == 90


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
    line = only_line(run_here(tmp_path, str(recorded.folder), *options, module="zoo.commands.edit"))
    assert all(word in line for word in words), line


def test_ctrl_c_ends_the_page_and_prints_how_to_resume(recorded: Written, tmp_path: Path) -> None:
    folder = shutil.copytree(recorded.folder, tmp_path / "my lap")
    (folder / "IMG" / recorded.image(4).name).unlink()
    process = start(tmp_path, "zoo.commands.edit", str(folder), "drop=15-20", "mirror=11", "port=0")
    lines = [process.stdout.readline() for _ in range(4)]
    assert "skipped 1 row" in lines[1]
    # The log's row 5 is not read.
    assert lines[2] == f"the first edited row, 11, is {folder}/driving_log.csv, row 12\n"
    assert "open http://127.0.0.1:" in lines[3]
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=20)
    assert process.returncode == 0, rest
    assert f"next: drivezoo edit '{folder}' drop=15-20 mirror=11" in rest
    assert "Traceback" not in rest


def test_a_port_in_use_is_named_with_its_holder() -> None:
    with (
        PageServer(0, lambda *_: []) as first,
        pytest.raises(InputError, match=rf"port={first.server_port}: held by .*port=0"),
    ):
        PageServer(first.server_port, lambda *_: [])


def test_two_servers_share_no_port_on_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.SO_EXCLUSIVEADDRUSE", -5, raising=False)
    server = runpy.run_path(str(ROOT / "zoo" / "base" / "page_server.py"))["PageServer"]
    assert not server.allow_reuse_address
