"""Files that are replaced in one step, also where an open file cannot be replaced."""

from pathlib import Path

import pytest

from zoo.base import whole_file
from zoo.base.whole_file import write_whole


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
