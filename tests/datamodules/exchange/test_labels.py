"""Formats of labels beside images: units, signs, and files that are damaged or cut short."""

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.format_options import ReadOptions
from datamodules.looking.findings import find_oddities
from datamodules.looking.sign_evidence import find_sign_evidence
from datamodules.recording import LONG_DRIVE, Recording
from datamodules.recording_format import find_format, read_recordings
from datamodules.view import View
from datamodules.view_store import cache_key
from tests.foreign_recordings import NS, ROWS, STEERING, challenge2_test, challenge2_training, table
from zoo.base.errors import InputError


def read(folder: Path, **options: object) -> Recording:
    return find_format(folder)[1].read(folder, ReadOptions(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("write", [challenge2_test, challenge2_training])
def test_steering_is_a_share_of_full_lock_with_right_positive_and_blocks_are_long(
    write: Callable[[Path], Path], tmp_path: Path
) -> None:
    recording = read(write(tmp_path / "recording"))
    check_shares_of_full_lock(recording, 1e-9)
    assert recording.blocks == LONG_DRIVE


def check_shares_of_full_lock(recording: Recording, tolerance: float) -> None:
    assert np.abs(recording.steering - STEERING).max() <= tolerance
    assert np.diff(recording.time_s) == pytest.approx(0.05, abs=1e-3)
    assert recording.image(ROWS - 1).ndim == 3
    evidence = find_sign_evidence(recording)
    assert evidence.is_clear
    assert evidence.correlation > 0.8
    assert "right" in recording.notes[0]


def test_a_table_with_a_capital_suffix_is_detected(tmp_path: Path) -> None:
    (tmp_path / "ROWS.PARQUET").write_bytes(b"PAR1")
    assert find_format(tmp_path / "ROWS.PARQUET")[0] == "table"


def test_side_cameras_are_those_nearest_in_time(tmp_path: Path) -> None:
    recording = read(challenge2_training(tmp_path / "recording"))
    for row, (center, left, right) in enumerate(recording.images.tolist()):
        stamps = [int(Path(path).stem) for path in (center, left, right)]
        assert stamps[0] == NS + 50_000_000 * row
        assert [stamp - stamps[0] for stamp in stamps[1:]] == [20_000_000, 10_000_000]
    assert recording.speed_mph == pytest.approx(10)


COLUMNS = {"image": "path", "steering": "turn"}
HEADER = "timestamp,frame_id,filename,angle,speed\n"


@pytest.mark.parametrize("middle", [0.3, -0.6])
def test_a_clip_of_one_bend_is_no_other_unit(middle: float, tmp_path: Path) -> None:
    folder = table(tmp_path / "bend", middle + STEERING / 9)
    with pytest.raises(InputError, match="on one side of 0") as caught:
        read_recordings(str(folder), format="table", columns=COLUMNS)
    assert "not share" not in str(caught.value)
    match = re.search(r'name "data\.steering=(\{[^}]*\})"', str(caught.value))
    recording = read_recordings(str(folder), format="table", columns=COLUMNS, steering=match[1])
    assert recording.steering == pytest.approx(middle + STEERING / 9)


def test_a_number_that_marks_rows_of_a_table_is_no_unit(tmp_path: Path) -> None:
    marked = np.where(np.arange(ROWS) % 9 == 5, -3.0, STEERING)
    folder = table(tmp_path / "marked", marked)
    options = {"format": "table", "columns": COLUMNS, "steering": {"unit": "share"}}
    with pytest.raises(InputError, match=r"-3, beyond -1\.\.1.*on_bad_row=skip"):
        read_recordings(str(folder), **options)
    assert len(read_recordings(str(folder), **options, on_bad_row="skip")) == (marked > -3).sum()


@pytest.mark.parametrize("first_s", [0, 1_700_000_000])
@pytest.mark.parametrize("unit_s", [1, 1e-3, 1e-6, 1e-9])
def test_the_steps_of_times_tell_their_unit(unit_s: float, first_s: int, tmp_path: Path) -> None:
    log = table(tmp_path / "recording") / "my.csv"
    head, *rows = log.read_text().splitlines()
    times = [f"{round(first_s / unit_s) + row / 20 / unit_s:.2f}" for row in range(ROWS)]
    timed = [f"{row},{time}" for row, time in zip(rows, times, strict=True)]
    log.write_text("\n".join([f"{head},at", *timed, ""]))
    how = {"format": "table", "steering": {"unit": "share"}}
    recording = read_recordings(str(log), columns=COLUMNS | {"time": "at"}, **how)
    assert recording.time_s[0] == pytest.approx(first_s)
    assert np.diff(recording.time_s) == pytest.approx(np.full(ROWS - 1, 0.05), abs=1e-6)


def test_skipping_bad_images_is_offered_if_others_are_left(tmp_path: Path) -> None:
    folder = table(tmp_path / "some")
    how = {"format": "table", "columns": COLUMNS, "steering": {"unit": "share"}}
    for row in range(30, ROWS):
        (folder / f"pics/{row}.png").unlink()
    lacking = r"row 32: no centre image .*the images again.*on_bad_image=skip"
    with pytest.raises(InputError, match=lacking):
        read_recordings(str(folder), **how)
    recording = read_recordings(str(folder), **how, on_bad_image="skip")
    assert len(recording) == 30
    assert "row 32" in recording.bad_images[0]
    shutil.rmtree(folder / "pics")
    for choice in ("fail", "skip"):
        with pytest.raises(InputError, match="the images again") as caught:
            read_recordings(str(folder), **how, on_bad_image=choice)
        assert not re.search("on_bad_image|images=", str(caught.value))


@pytest.mark.parametrize("stored", [False, True])
def test_a_parquet_table_names_or_holds_its_images(stored: bool, tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    folder = table(tmp_path / "recording")
    names = [f"pics/{row}.png" for row in range(ROWS)]
    data = [{"bytes": (folder / name).read_bytes(), "path": "x"} for name in names]
    columns = {"turn": STEERING, "view": data if stored else names, "s": np.arange(ROWS) / 20}
    columns["side"] = columns["view"][::-1]
    parquet.write_table(pa.table(columns), folder / "rows.parquet")
    options = {"columns": "{image: view, left: side, steering: turn, time: s}"}
    recording = read(folder / "rows.parquet", **options)
    view = View((0, 0), "rgb", None)
    assert len({cache_key(recording.images[:, camera], view) for camera in (0, 1)}) == 2
    assert recording.steering == pytest.approx(STEERING)
    last = cv2.imread(str(folder / names[-1]))[:, :, ::-1]
    np.testing.assert_array_equal(recording.image(ROWS - 1), last)
    with pytest.raises(InputError, match="no column other"):
        read(folder / "rows.parquet", columns={"image": "view", "steering": "other"})


def test_degrees_under_a_name_of_radians_stop(tmp_path: Path) -> None:
    folder = challenge2_test(tmp_path / "recording")
    log = folder / "CH2_final_evaluation.csv"
    head, *rows = log.read_text().splitlines()
    fields = [row.split(",") for row in rows]
    rows = [f"{name},{math.degrees(float(angle))},{half}" for name, angle, half in fields]
    log.write_text("\n".join([head, *rows, ""]))
    with pytest.raises(InputError, match=r"not rad, 8\.2 at full lock"):
        read(folder)


def test_a_recording_without_rows_is_refused(tmp_path: Path) -> None:
    check_without_rows("challenge2", {"interpolated.csv": HEADER}, tmp_path)


def check_without_rows(name: str, files: dict[str, str], folder: Path) -> None:
    for file, text in files.items():
        (folder / file).write_text(text)
    with pytest.raises(InputError, match=f"{re.escape(str(folder))}: .*; (name|record)"):
        read_recordings(str(folder), format=name)


def test_bad_rows_alone_are_named(tmp_path: Path) -> None:
    (tmp_path / "interpolated.csv").write_text(f"{HEADER}0,center_camera,0.jpg,much,1\n")
    with pytest.raises(InputError, match=r"interpolated.csv, row 2: angle .*; correct"):
        read(tmp_path)


def test_a_parquet_table_that_repeats_a_long_text_is_refused(tmp_path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    rows, file = 350, tmp_path / "rows.parquet"
    parquet.write_table(pa.table({"turn": np.zeros(rows), "view": ["a" * 200_000] * rows}), file)
    assert file.stat().st_size < 1_000_000
    with pytest.raises(InputError, match="after decompression"):
        read(file, columns={"image": "view", "steering": "turn"})


def test_a_folder_of_two_formats_names_both_and_the_key(tmp_path: Path) -> None:
    folder = challenge2_test(tmp_path / "recording")
    (folder / "driving_log.csv").write_text("0.jpg,,,0,0,0,1\n")
    with pytest.raises(InputError, match=r"recording: .*udacity .*challenge2 .*name one: format="):
        find_format(folder)
    assert find_format(folder, "challenge2")[0] == "challenge2"


def test_times_that_run_backward_are_named_with_the_row(tmp_path: Path) -> None:
    folder = challenge2_training(tmp_path / "recording")
    log = folder / "interpolated.csv"
    head, *rows = log.read_text().splitlines()
    center = [row for row in rows if "center_camera" in row]
    log.write_text("\n".join([head, *center[:20], *center[40:], *center[20:40], ""]))
    texts = [oddity.text for oddity in find_oddities(read_recordings(str(folder)))]
    row = len(center) - 20 + 2
    words = rf"interpolated\.csv, row {row}: its time is before .*\(1 such rows\).*unless the clock"
    assert any(re.search(words, text) for text in texts)
