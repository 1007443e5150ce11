"""`drivezoo convert`: formats that it finds, wrong uses, and what is left after a failure."""

import sys
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


@pytest.mark.parametrize("to", ["lerobot", "donkeycar"])
def test_an_existing_folder_is_never_written_to(to: str, recorded: Written, tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    result = run_here(
        tmp_path, str(recorded.folder), f"to={to}", "out=old", module="zoo.commands.convert"
    )
    assert "out=old: exists already" in only_line(result)
    assert list((tmp_path / "old").iterdir()) == []


def test_wrong_uses_name_the_right_one(recorded: Written, tmp_path: Path) -> None:
    source = str(recorded.folder)
    with pytest.raises(UsageError, match=r"name another format: to=lerobot.* to=donkeycar"):
        convert.main([source])
    with pytest.raises(UsageError, match=r"to=donkycar: no format .* did you mean donkeycar\?"):
        convert.main([source, "to=donkycar"])
    with pytest.raises(UsageError, match=r"to=udacity: .* is a recording already"):
        convert.main([source, "to=udacity"])
    with pytest.raises(InputError, match="no such folder"):
        convert.main([str(tmp_path / "nowhere"), "to=lerobot"])
    with pytest.raises(InputError, match="of no other format"):
        convert.main([str(tmp_path), "to=lerobot"])


def test_a_missing_pyarrow_is_one_line(
    recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    out = tmp_path / "lr"
    with pytest.raises(InputError, match=r"pip install 'drivezoo\[parquet\]'"):
        convert.main([str(recorded.folder), "to=lerobot", f"out={out}"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("to", ["lerobot", "donkeycar"])
def test_rows_and_size_are_chosen(to: str, recorded: Written, tmp_path: Path) -> None:
    if to == "lerobot":
        pytest.importorskip("pyarrow")
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
