"""Edits of a recording, and the new folder, while the recorded one stays."""

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from datamodules.edited_recording import write_edited
from datamodules.image import read_image
from datamodules.looking.findings import find_oddities
from datamodules.recording import Recording
from datamodules.recording_edits import (
    Edits,
    drop,
    edit_options,
    merge,
    mirror,
    parse_stretches,
    restore,
    split,
    trim,
    typed_edits,
)
from datamodules.recording_format import read_recordings
from datamodules.stretches import find_breaks, missing_rows
from tests.recordings import Written, write_recording
from tests.refusals import refusal
from tests.unchanged import unchanged
from zoo.base.errors import InputError, UsageError

ROWS = 40


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return write_recording(tmp_path_factory.mktemp("source") / "lap", ROWS, speed=20.5)


@pytest.fixture(scope="module")
def recording(source: Written) -> Recording:
    return read_recordings(str(source.folder))


def rewritten(recording: Recording, edits: Edits, folder: Path) -> Recording:
    """Write a recording's edits into a folder, and read it."""
    write_edited(recording, edits, folder)
    return read_recordings(str(folder))


def test_kept_rows_are_as_recorded(recording: Recording, source: Written, tmp_path: Path) -> None:
    with unchanged(source.folder):
        written = write_edited(recording, drop(Edits(ROWS), (5, 30)), tmp_path / "new")
    assert (written.folders, written.rows) == ((tmp_path / "new",), (15,))
    again = read_recordings(str(tmp_path / "new"))
    rows = [*range(5), *range(30, 40)]
    for name in ("steering", "throttle", "brake", "speed_mph", "time_s"):
        np.testing.assert_array_equal(getattr(again, name), getattr(recording, name)[rows])
    for new, row in zip(again.images, rows, strict=True):
        for path, old in zip(new, recording.images[row], strict=True):
            assert Path(path).read_bytes() == Path(old).read_bytes()
    assert np.flatnonzero(find_breaks(again)).tolist() == [4], "the gap is seen as a pause"


def test_the_new_folder_needs_no_other(source: Written, tmp_path: Path) -> None:
    shutil.copytree(source.folder, tmp_path / "old")
    write_edited(read_recordings(str(tmp_path / "old")), Edits(ROWS), tmp_path / "new")
    shutil.rmtree(tmp_path / "old")
    (tmp_path / "new").rename(tmp_path / "moved")
    again = read_recordings(str(tmp_path / "moved"))
    assert read_image(again.images[0, 0]).shape == (160, 320, 3)


def failing(error: OSError) -> Callable[..., None]:
    def fail(*_: object) -> None:
        raise error

    return fail


# The second is Windows' for a disk without links, such as one of exFAT.
@pytest.mark.parametrize("number", [errno.EPERM, errno.EINVAL])
def test_images_are_links_or_else_copies(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def images(folder: Path) -> list[Path]:
        return sorted((folder / "IMG").iterdir())

    edits = drop(Edits(ROWS), (2, ROWS))
    write_edited(recording, edits, tmp_path / "linked")
    assert all(path.stat().st_nlink > 1 for path in images(tmp_path / "linked"))

    monkeypatch.setattr(os, "link", failing(OSError(number, os.strerror(number))))
    write_edited(recording, edits, tmp_path / "copied")
    assert all(path.stat().st_nlink == 1 for path in images(tmp_path / "copied"))
    assert len(images(tmp_path / "copied")) == 6


def test_mirroring_turns_images_cameras_and_steering(recording: Recording, tmp_path: Path) -> None:
    edits = mirror(drop(Edits(ROWS), (0, 10)), (20, 30))
    again = rewritten(recording, edits, tmp_path / "new")
    np.testing.assert_array_equal(again.steering[:20], recording.steering[np.r_[10:20, 30:40]])
    np.testing.assert_array_equal(again.steering[20:], -recording.steering[20:30])
    assert "-0," not in (tmp_path / "new" / "driving_log.csv").read_text()
    for camera, other in ((0, 0), (1, 2), (2, 1)):
        new, old = read_image(again.images[20, camera]), read_image(recording.images[20, other])
        assert np.abs(new.astype(int) - old[:, ::-1]).mean() < 3, "only the JPEG differs"
    assert again.time_s[20] == recording.time_s[20]
    assert find_breaks(again)[19], "no window of frames has rows of both kinds"
    assert "backward_times" not in {oddity.kind for oddity in find_oddities(again)}


def test_recordings_become_one_although_names_repeat(source: Written, tmp_path: Path) -> None:
    shutil.copytree(source.folder, tmp_path / "other")
    both = read_recordings([str(source.folder), str(tmp_path / "other")])
    Path(both.images[ROWS, 0]).write_bytes(source.image(3).read_bytes())
    again = rewritten(both, Edits(2 * ROWS), tmp_path / "new")
    assert len(set(again.images.flat)) == 6 * ROWS
    assert Path(again.images[ROWS, 0]).read_bytes() == source.image(3).read_bytes()
    np.testing.assert_array_equal(again.time_s, both.time_s)


@pytest.mark.parametrize("has_times", [False, True])
def test_a_gap_is_an_empty_line(has_times: bool, tmp_path: Path) -> None:
    folder = write_recording(tmp_path / "old", ROWS, cameras=("center",)).folder
    names = sorted((folder / "IMG").iterdir())
    if not has_times:
        names = [path.rename(path.with_name(f"{at:03d}.jpg")) for at, path in enumerate(names)]
    lines = [f"IMG/{path.name},,,0.1,0.5,0,9" for path in names]
    (folder / "driving_log.csv").write_text("\n".join(lines) + "\n")
    again = rewritten(read_recordings(str(folder)), drop(Edits(ROWS), (5, 6)), tmp_path / "new")
    assert np.flatnonzero(np.diff(again.line) > 1).tolist() == [4]


def test_source_gaps_and_mirrored_ends_are_empty_lines(source: Written, tmp_path: Path) -> None:
    shutil.copytree(source.folder, tmp_path / "old")
    (tmp_path / "old" / "IMG" / source.image(10).name).unlink()
    whole = read_recordings(str(tmp_path / "old"), on_bad_image="skip")
    copy = rewritten(whole, Edits(ROWS - 1), tmp_path / "copy")
    assert np.flatnonzero(missing_rows(copy)).tolist() == [9]
    again = rewritten(copy, mirror(Edits(ROWS - 1), (20, ROWS - 1)), tmp_path / "again")
    assert np.flatnonzero(missing_rows(again)).tolist() == [9, 19]


def test_rows_that_share_an_image_keep_their_times(source: Written, tmp_path: Path) -> None:
    lines = [f"{source.image(row // 2)},0,{row / 20}" for row in range(ROWS)]
    (tmp_path / "my.csv").write_text("\n".join(["path,turn,time", *lines]))
    columns = {"image": "path", "steering": "turn", "time": "time"}
    told = {"columns": columns, "steering": {"unit": "share"}, "images": str(source.folder)}
    shared = read_recordings(str(tmp_path / "my.csv"), format="table", **told)
    again = rewritten(shared, Edits(ROWS), tmp_path / "new")
    np.testing.assert_allclose(again.time_s, np.arange(ROWS) / 20)


def test_a_row_with_a_bad_image_is_left_out(source: Written, tmp_path: Path) -> None:
    shutil.copytree(source.folder, tmp_path / "old")
    secret = tmp_path / "secret.jpg"
    secret.write_text("no image")
    recording = read_recordings(str(tmp_path / "old"))
    Path(recording.images[3, 0]).write_bytes(source.image(3).read_bytes()[:-40])
    Path(recording.images[7, 1]).unlink()
    Path(recording.images[7, 1]).symlink_to(secret)
    written = write_edited(recording, Edits(ROWS), tmp_path / "new")
    assert written.rows == (ROWS - 2,)
    assert "row 4: " in written.left_out[0]
    assert "truncated" in written.left_out[0]
    assert "row 8: " in written.left_out[1]
    assert len(list((tmp_path / "new" / "IMG").iterdir())) == 3 * (ROWS - 2)


def test_an_existing_folder_is_refused(recording: Recording, source: Written) -> None:
    with unchanged(source.folder):
        words = refusal(write_edited, recording, Edits(ROWS), source.folder)
    assert "exists already; name another" in words


def test_a_failure_leaves_nothing(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "link", failing(OSError(28, "No space left on device")))
    with pytest.raises(InputError, match=r"No space left on device.*out="):
        write_edited(recording, Edits(ROWS), tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


TEN = Edits(10)


def rows_of(edits: Edits) -> list[list[int]]:
    return [rows.tolist() for rows, _ in edits.parts()]


def test_dropping_leaves_out_rows_and_keeps_the_numbers_of_the_others() -> None:
    edits = drop(drop(TEN, (2, 4)), (3, 6))
    assert (edits.dropped, rows_of(edits)) == (((2, 6),), [[0, 1, 6, 7, 8, 9]])
    assert TEN.dropped == (), "the edits before stay, for undo"


def test_restoring_undoes_dropping_and_mirroring_of_a_stretch() -> None:
    edits = restore(mirror(drop(TEN, (0, 5)), (0, 5)), (1, 2))
    assert edits.dropped == edits.mirrored == ((0, 1), (2, 5))


def test_trimming_leaves_out_what_is_outside() -> None:
    assert rows_of(trim(TEN, (3, 6))) == [[3, 4, 5]]
    assert trim(TEN, (0, 10)) == TEN


def test_mirroring_twice_mirrors_back() -> None:
    assert mirror(mirror(TEN, (2, 4)), (2, 4)) == TEN
    assert mirror(mirror(TEN, (2, 4)), (2, 6)).mirrored == ((2, 6),)


def test_splitting_begins_a_part_and_merging_joins_it_again() -> None:
    edits = split(split(TEN, 7), 3)
    assert rows_of(edits) == [[0, 1, 2], [3, 4, 5, 6], [7, 8, 9]]
    assert rows_of(merge(edits, (2, 4))) == [[0, 1, 2, 3, 4, 5, 6], [7, 8, 9]]
    assert rows_of(drop(edits, (0, 3))) == [[3, 4, 5, 6], [7, 8, 9]], "no part without rows"


@pytest.mark.parametrize("stretch", [(3, 3), (4, 2), (-1, 2), (8, 11)])
def test_a_stretch_outside_of_the_recording_is_refused(stretch: tuple[int, int]) -> None:
    for edit in (drop, restore, trim, mirror, merge):
        assert "1..10" in refusal(edit, TEN, stretch)


@pytest.mark.parametrize("row", [0, 10, -1])
def test_a_part_begins_inside_of_the_recording(row: int) -> None:
    with pytest.raises(UsageError, match=r"split.*2\.\.10"):
        split(TEN, row)


def test_typed_edits_count_rows_from_1_and_include_the_last() -> None:
    edits = typed_edits(10, drop_text="2-3, 9-", mirror_text="5", split_text="6")
    assert edits == Edits(10, dropped=((1, 3), (8, 10)), mirrored=((4, 5),), splits=(5,))
    assert typed_edits(10, keep_text="3-5,8").dropped == ((0, 2), (5, 7), (8, 10))


def test_edits_can_be_typed_again() -> None:
    edits = split(mirror(drop(drop(TEN, (0, 1)), (4, 6)), (2, 8)), 5)
    texts = dict(option.split("=") for option in edit_options(edits))
    assert typed_edits(10, texts["drop"], "", texts["mirror"], texts["split"]) == edits


NO_STRETCHES = {text: r"drop=.*120-180" for text in ("", "a", "1-2-3", "-3", "1.5", "²")}
NO_ROWS = {text: rf"drop={text}: .*1\.\.10" for text in ("0", "11", "5-3", "9-11")}


@pytest.mark.parametrize(("text", "words"), (NO_STRETCHES | NO_ROWS).items())
def test_what_is_no_stretch_of_the_recording_is_refused(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        parse_stretches("drop", text, 10)
