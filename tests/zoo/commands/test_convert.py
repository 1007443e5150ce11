"""`drivezoo convert`: formats that it finds, wrong uses, and what is left after a failure."""

import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from datamodules.stretches import find_breaks, missing_rows
from tests.foreign_recordings import ROWS, challenge2_test, table
from tests.recordings import Written
from tests.zoo.command_runs import only_line, run_here, succeed
from zoo.base.errors import InputError, UsageError
from zoo.commands.convert import convert


def run_convert(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    return run_here(cwd, *arguments, module="zoo.commands.convert")


def test_a_recording_becomes_a_tub_and_a_tub_a_recording(recorded: Written, tmp_path: Path) -> None:
    there = succeed(run_convert(tmp_path, str(recorded.folder), "to=donkeycar", "out=tub"))
    back = succeed(run_convert(tmp_path, "tub"))
    assert there.splitlines() == [
        "recording -> Donkeycar tub: 120 rows, 1 continuous drive",
        "- a tub has one camera: the side cameras are left out",
        "wrote: tub",
        f"next: donkey train --tub {tmp_path / 'tub'}",
        "      in your car's folder",
    ]
    assert back.splitlines()[-2:] == ["wrote: tub_udacity", "next: drivezoo check tub_udacity"]
    again = read_recordings(str(tmp_path / "tub_udacity"))
    assert again.steering.tolist() == recorded.steering.tolist()


@pytest.mark.parametrize("order", [("tub", "log"), ("tub", "tub")])
def test_a_tub_is_joined_with_others(
    order: tuple[str, str], recorded: Written, tmp_path: Path
) -> None:
    succeed(run_convert(tmp_path, str(recorded.folder), "to=donkeycar", "out=tub"))
    sources = [{"tub": "tub", "log": str(recorded.folder)}[name] for name in order]
    printed = succeed(run_convert(tmp_path, *sources, "to=donkeycar", "out=both"))
    assert "240 rows, 2 continuous drives" in printed
    steering = read_recordings(str(tmp_path / "both")).steering
    assert steering.tolist() == [*recorded.steering, *recorded.steering]


def test_wrong_uses_name_the_right_one(recorded: Written, tmp_path: Path) -> None:
    for source, keys, kind, words in (
        (recorded.folder, [], UsageError, r"name another: to=donkeycar"),
        (recorded.folder, ["to=donkycar"], UsageError, r"no format .* did you mean donkeycar\?"),
        (recorded.folder, ["to=udacity"], UsageError, r"to=udacity: .* is a recording already"),
        (tmp_path / "nowhere", ["to=donkeycar"], InputError, "no such folder"),
        (tmp_path, ["to=donkeycar"], InputError, "of no other format"),
    ):
        with pytest.raises(kind, match=words):
            convert.main([str(source), *keys])


def test_rows_and_size_are_chosen(recorded: Written, tmp_path: Path) -> None:
    check_rows_and_size("donkeycar", recorded, tmp_path)


def check_rows_and_size(to: str, recorded: Written, tmp_path: Path) -> None:
    """Check that `keep` and `size` choose what is written in a format."""
    words = ("size=[48,64]", "keep=2-9", f"to={to}", "out=new")
    printed = succeed(run_convert(tmp_path, str(recorded.folder), *words))
    assert "8 of" in printed
    assert "resized to 64 x 48" in printed
    before, after = (read_recordings(str(path)) for path in (recorded.folder, tmp_path / "new"))
    assert after.frame_size() == (48, 64)
    np.testing.assert_array_equal(after.steering, before.steering[1:9])
    small = cv2.resize(before.image(1), (64, 48), interpolation=cv2.INTER_AREA)
    assert np.abs(after.image(0).astype(int) - small).mean() < 4


@pytest.mark.parametrize("to", ["udacity", "donkeycar"])
def test_rows_with_bad_images_are_left_out_and_counted(to: str, tmp_path: Path) -> None:
    images = sorted((challenge2_test(tmp_path / "old") / "center").iterdir())
    images[4].unlink()
    images[6].write_text("no image")
    printed = succeed(run_convert(tmp_path, "old", f"to={to}", "out=new"))
    assert f": {ROWS - 2} rows" in printed
    assert "row 6: no centre image" in printed
    assert to == "udacity" or "row 8: " in printed
    assert len(read_recordings(str(tmp_path / "new"))) == ROWS - 2


@pytest.mark.parametrize("to", ["udacity", "donkeycar"])
def test_assumptions_are_printed_and_left_out_rows_are_a_pause(to: str, tmp_path: Path) -> None:
    columns = "columns={image: path, steering: turn}"
    words = (str(table(tmp_path / "table")), "format=table", columns, "keep=1-20,22-60")
    printed = succeed(run_convert(tmp_path, *words, f"to={to}", "out=new"))
    assert printed.count(" steering: ") == 1
    assert "times are missing" in printed
    copy = read_recordings(str(tmp_path / "new"))
    assert np.flatnonzero(find_breaks(copy)).tolist() == [19]


@pytest.mark.parametrize("to", ["udacity", "donkeycar"])
def test_no_window_of_a_copy_reaches_over_a_missing_row(
    to: str, recorded: Written, tmp_path: Path
) -> None:
    check_a_missing_row(to, recorded, tmp_path)


def check_a_missing_row(to: str, recorded: Written, tmp_path: Path) -> None:
    """Check that a copy in a format keeps a missing row, which the times do not show."""
    source = recorded.folder
    if to == "udacity":
        succeed(run_convert(tmp_path, str(source), "to=donkeycar", "out=tub"))
        source = tmp_path / "tub"
    words = (str(source), "keep=1-20,22-120", f"to={to}", "out=new")
    assert "119 rows, 2 continuous drives" in succeed(run_convert(tmp_path, *words))
    copy = read_recordings(str(tmp_path / "new"))
    assert np.flatnonzero(missing_rows(copy)).tolist() == [19]


def test_rows_that_are_none_are_refused(recorded: Written, tmp_path: Path) -> None:
    words = (str(recorded.folder), "keep=first", "to=donkeycar", "out=new")
    assert "keep=first" in only_line(run_convert(tmp_path, *words))
    assert not (tmp_path / "new").exists()
