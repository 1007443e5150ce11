"""An editing session: undo and redo, and a recording that is written in the background."""

from pathlib import Path

from datamodules.recording_edits import Edits
from datamodules.recording_format import read_recordings
from tests.recordings import Written
from zoo.edit.edit_session import EditSession


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


def test_the_new_folder_is_named_after_the_recorded_one(recorded: Written) -> None:
    name = f"{recorded.folder.name}_edited"
    assert session_of(recorded).state()["out"] == str(recorded.folder.with_name(name))


def test_a_second_writing_goes_to_another_folder(recorded: Written, tmp_path: Path) -> None:
    session = session_of(recorded, tmp_path / "new")
    session.change("trim", (10, 12))
    for name in ("new", "new_2"):
        session.write()
        assert session.written.folders == (tmp_path / name,)
