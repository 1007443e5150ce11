"""`drivezoo convert`: formats that it finds, wrong uses, and what is left after a failure."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.recordings import Written
from tests.zoo.command_runs import only_line, run_here, succeed
from zoo.base.errors import InputError, UsageError
from zoo.commands.convert import convert


def test_a_recording_becomes_a_tub_and_a_tub_a_recording(recorded: Written, tmp_path: Path) -> None:
    there = run_here(
        tmp_path, str(recorded.folder), "to=donkeycar", "out=tub", module="zoo.commands.convert"
    )
    back = run_here(tmp_path, "tub", module="zoo.commands.convert")

    assert there.returncode == back.returncode == 0, there.stderr + back.stderr
    assert there.stdout.splitlines() == [
        "recording -> Donkeycar tub: 120 rows, 1 continuous drive",
        "- a tub has one camera: the side cameras are left out",
        "wrote: tub",
        "next: donkey train --tub tub",
        "      in your car's folder",
    ]
    new = tmp_path / "tub_udacity"
    assert back.stdout.splitlines()[-2:] == [
        "wrote: tub_udacity",
        "next: drivezoo check tub_udacity",
    ]
    again = read_recordings(str(new))
    assert again.steering.tolist() == recorded.steering.tolist()


def test_an_existing_folder_is_never_written_to(recorded: Written, tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    result = run_here(
        tmp_path, str(recorded.folder), "to=donkeycar", "out=old", module="zoo.commands.convert"
    )
    assert "out=old: exists already" in only_line(result)
    assert list((tmp_path / "old").iterdir()) == []


def test_wrong_uses_name_the_right_one(recorded: Written, tmp_path: Path) -> None:
    source = str(recorded.folder)
    with pytest.raises(UsageError, match=r"name another format: to=donkeycar"):
        convert.main([source])
    with pytest.raises(UsageError, match=r"to=donkycar: no format .* did you mean donkeycar\?"):
        convert.main([source, "to=donkycar"])
    with pytest.raises(UsageError, match=r"to=udacity: .* is a recording already"):
        convert.main([source, "to=udacity"])
    with pytest.raises(InputError, match="no such folder"):
        convert.main([str(tmp_path / "nowhere"), "to=donkeycar"])
    with pytest.raises(InputError, match="of no other format"):
        convert.main([str(tmp_path), "to=donkeycar"])


def test_rows_and_size_are_chosen(recorded: Written, tmp_path: Path) -> None:
    check_rows_and_size("donkeycar", recorded, tmp_path)


def check_rows_and_size(to: str, recorded: Written, tmp_path: Path) -> None:
    """Check that `keep` and `size` choose what is written in a format."""
    words = ("size=[48,64]", "keep=2-9", f"to={to}", "out=new")
    printed = succeed(
        run_here(tmp_path, str(recorded.folder), *words, module="zoo.commands.convert")
    )
    assert "8 of" in printed
    assert "resized to 64 x 48" in printed
    before, after = (read_recordings(str(path)) for path in (recorded.folder, tmp_path / "new"))
    assert after.frame_size() == (48, 64)
    np.testing.assert_array_equal(after.steering, before.steering[1:9])
    small = cv2.resize(before.image(1), (64, 48), interpolation=cv2.INTER_AREA)
    assert np.abs(after.image(0).astype(int) - small).mean() < 4


def test_rows_that_are_none_are_refused(recorded: Written, tmp_path: Path) -> None:
    words = (str(recorded.folder), "keep=first", "to=donkeycar", "out=new")
    assert "keep=first" in only_line(run_here(tmp_path, *words, module="zoo.commands.convert"))
    assert not (tmp_path / "new").exists()
