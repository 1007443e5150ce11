"""Parts of a recording, and how alike they are."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datamodules.looking.findings import report_recordings
from datamodules.looking.leak import leak_lines, random_split_leak, seconds_apart
from datamodules.recording import LONG_DRIVE, SHORT_DRIVES, Recording
from datamodules.recording_format import read_recordings
from datamodules.split import PARTS, Split, rows_per_second, split_rows, split_words, write_split
from datamodules.stretches import mean_rate
from tests import foreign_recordings as foreign
from tests.recordings import recording_in_memory, write_recording
from zoo.base.errors import InputError


def driven(rows: int, sizes: tuple[int, ...] = ()) -> Recording:
    return recording_in_memory(np.zeros(rows), sizes=sizes)


def part_of_each_row(split: Split, rows: int) -> np.ndarray:
    """Return each row's part, int64 [rows], -1 for none; check that no row is in two."""
    part = np.full(rows, -1)
    for number, name in enumerate(PARTS):
        chosen = getattr(split, name)
        assert (np.diff(chosen) > 0).all(), "ascending, so each once"
        assert (part[chosen] == -1).all(), "in one part"
        part[chosen] = number
    return part


def distance(rows: np.ndarray, other: np.ndarray) -> int:
    """Return the number of rows between the nearest rows of two parts."""
    return int(np.abs(rows[:, None] - other[None]).min())


@given(rows=st.integers(60, 3000), seed=st.integers(0, 50))
def test_blocks_of_any_recording_are_apart(rows, seed):
    split = split_rows(driven(rows), "blocks", seed=seed)
    part_of_each_row(split, rows)
    gap = min(15, max(rows // 20, 1))  # a second, or less with shorter blocks
    for part, other in (("train", "val"), ("train", "test"), ("val", "test")):
        assert distance(getattr(split, part), getattr(split, other)) > gap


def test_only_rows_near_another_part_are_dropped():
    split = split_rows(driven(9000), "blocks", block_s=10, gap_s=1)
    part = part_of_each_row(split, 9000)
    for dropped in np.flatnonzero(part == -1):
        assert len(set(part[max(dropped - 15, 0) : dropped + 16].tolist()) - {-1}) >= 1
        assert dropped not in split.test
    assert (part == -1).mean() < 0.06


def test_longer_gap_drops_more_training_rows():
    short = split_rows(driven(9000), "blocks", gap_s=0)
    long = split_rows(driven(9000), "blocks", gap_s=4)
    assert len(short.train) + len(short.val) + len(short.test) == 9000
    assert distance(long.train, long.test) > 60
    np.testing.assert_array_equal(short.test, long.test)


@pytest.mark.parametrize("kind", ["blocks", "random"])
@pytest.mark.parametrize(("val", "test"), [(0.1, 0.1), (0.2, 0.0), (0.3, 0.2), (0.0, 0.15)])
def test_shares_come_near_to_those_asked_for(kind, val, test):
    split = split_rows(driven(6000), kind, val_share=val, test_share=test)
    assert len(split.val) / 6000 == pytest.approx(val, abs=0.03)
    assert len(split.test) / 6000 == pytest.approx(test, abs=0.03)
    assert len(split.train) / 6000 == pytest.approx(1 - val - test, abs=0.08)


def test_random_uses_every_row_and_scatters_them():
    split = split_rows(driven(1000), "random", val_share=0.2, test_share=0.1)
    part = part_of_each_row(split, 1000)
    assert np.bincount(part).tolist() == [700, 200, 100]
    alone = [part[row - 1] != 1 and part[row + 1] != 1 for row in split.val if 0 < row < 999]
    assert np.mean(alone) > 0.5


@pytest.mark.parametrize("kind", ["blocks", "random"])
def test_same_seed_same_split(kind):
    splits = [split_rows(driven(3000), kind, seed=seed) for seed in (4, 4, 5)]
    np.testing.assert_array_equal(splits[0].test, splits[1].test)
    assert not np.array_equal(splits[0].test, splits[2].test)


def test_blocks_never_reach_across_recordings():
    """Rows of two recordings are no neighbours: none is dropped at their border."""
    split = split_rows(driven(600, (300, 300)), "blocks", val_share=0.5, test_share=0.0, block_s=20)
    part = part_of_each_row(split, 600)
    assert -1 in part, "some borders lie within a recording"
    for row in (299, 300):
        inner = part[row - 30 : row] if row == 299 else part[row + 1 : row + 31]
        assert part[row] == inner[-1 if row == 299 else 0] != -1


def test_a_border_at_a_recordings_end_drops_no_rows_of_the_next():
    """Each recording ends in a block of 5 rows, less than the gap; the next starts whole."""
    for seed in range(20):
        split = split_rows(driven(3010, (1505, 1505)), "blocks", 0.3, 0.3, seed=seed)
        assert (part_of_each_row(split, 3010)[1505 : 1505 + 15] != -1).all()


def test_whole_recordings():
    split = split_rows(driven(1000, (100,) * 10), "recording", val_share=0.2, test_share=0.1)
    part = part_of_each_row(split, 1000).reshape(10, 100)
    assert (part == part[:, :1]).all()
    assert np.bincount(part[:, 0]).tolist() == [7, 2, 1]


@pytest.mark.parametrize("rows", [10, 20, 45, 150])
def test_tiny_recording_still_gets_all_three_parts(rows):
    split = split_rows(driven(rows), "blocks")
    part_of_each_row(split, rows)
    assert min(len(split.train), len(split.val), len(split.test)) > 0


def test_two_rows_can_all_be_trained_on():
    assert split_rows(driven(2), "blocks", val_share=0, test_share=0).train.tolist() == [0, 1]


TOO_FEW = r"leaves no .*rows .*record more"


@pytest.mark.parametrize(
    ("recording", "kind", "shares", "words"),
    [
        (driven(100, (50, 50)), "recording", {}, r"needs 3 recordings, data\.root names 2"),
        (driven(100), "block", {}, r"data\.split=block is not one of blocks, random"),
        *((driven(rows), kind, {}, TOO_FEW) for kind in ("blocks", "random") for rows in (1, 2)),
        *(
            (driven(100), "random", {"val_share": val, "test_share": test}, r"data\.val_share")
            for val, test in ((-0.1, 0.1), (0.5, 0.5), (0.9, 0.3), (0.1, -0.2))
        ),
    ],
)
def test_a_split_that_cannot_be_says_what_to_set(recording, kind, shares, words):
    with pytest.raises(InputError, match=words):
        split_rows(recording, kind, **shares)


@pytest.fixture
def small(tmp_path) -> Recording:
    return read_recordings(str(write_recording(tmp_path / "lake", 40, cameras=("center",)).folder))


def test_a_written_split_of_recordings_whose_images_have_the_same_names_reads_back(tmp_path):
    roots = [str(write_recording(tmp_path / name, 60).folder) for name in ("lake", "hills")]
    both = read_recordings(roots)
    split = split_rows(both, "random")
    write_split(tmp_path / "split.csv", both, split)
    shutil.copytree(tmp_path / "hills", tmp_path / "moved" / "hills")
    moved = read_recordings([roots[0], str(tmp_path / "moved" / "hills")])
    again = split_rows(moved, str(tmp_path / "split.csv"))
    for name in PARTS:
        np.testing.assert_array_equal(getattr(again, name), getattr(split, name))
    ambiguous = [[Path(both.images[0, 0]).name, part] for part in ("train", "val")]
    with pytest.raises(InputError, match=r"row 2: several images are called center_"):
        split_rows(both, write_rows(tmp_path / "0.csv", ambiguous))


def test_the_rows_of_a_recording_that_is_named_twice_are_of_one_part(small, tmp_path):
    twice = read_recordings([*small.names, *small.names])
    split = split_rows(twice, "random")
    write_split(tmp_path / "split.csv", twice, split)
    np.testing.assert_array_equal(split_rows(twice, str(tmp_path / "split.csv")).train, split.train)


def test_the_gap_is_as_long_in_recordings_of_each_frame_rate():
    recording = recording_in_memory(np.zeros(4_000), sizes=(2_000, 2_000))
    recording.time_s[2_000:] = 9_000 + np.arange(2_000) / 60
    split = split_rows(recording, "blocks", block_s=10, gap_s=1)
    held_out = np.concatenate([split.val, split.test])
    for number in (0, 1):
        rows = held_out[recording.recording[held_out] == number]
        apart_s = np.abs(recording.time_s[rows][:, None] - recording.time_s[split.train]).min()
        assert 0.95 < apart_s < 1.2


def test_a_split_file_is_by_name_not_by_row(small, tmp_path):
    split = split_rows(small, "blocks")
    write_split(tmp_path / "split.csv", small, split)
    again = split_rows(small.keep(np.arange(40) >= 5), str(tmp_path / "split.csv"))
    for name in PARTS:
        rows = getattr(split, name)
        np.testing.assert_array_equal(getattr(again, name), rows[rows >= 5] - 5)


def test_a_split_of_images_named_as_formulas_reads_back_and_holds_none(small, tmp_path):
    names = [f"=HYPERLINK(1)\x1b{row}.jpg" for row in range(40)]
    small = replace(small, images=np.array([[f"IMG/{name}"] for name in names], object))
    split = split_rows(small, "blocks")
    write_split(tmp_path / "split.csv", small, split)
    written = (tmp_path / "split.csv").read_text()
    assert "\n=" not in written
    assert "\x1b" not in written
    np.testing.assert_array_equal(split_rows(small, str(tmp_path / "split.csv")).train, split.train)
    rows = [[names[row], part] for part in PARTS for row in getattr(split, part)]
    earlier = write_rows(tmp_path / "0.csv", rows)  # with the names as they are
    np.testing.assert_array_equal(split_rows(small, earlier).train, split.train)


def write_rows(path: Path, rows: list[list[str]]) -> str:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return str(path)


@pytest.mark.parametrize(
    ("part", "words"),
    [("train", "names no image of this recording"), ("dev", r"row 2: .*train, val, test")],
)
def test_a_split_file_of_other_images_or_parts_is_refused(small, tmp_path, part, words):
    path = write_rows(tmp_path / "split.csv", [["image", "part"], ["center_other.jpg", part]])
    with pytest.raises(InputError, match=rf"split\.csv.*{words}"):
        split_rows(small, path)


def test_rate_is_the_medians_and_without_times_the_simulators(small):
    assert rows_per_second(small) == pytest.approx(15, abs=0.3)
    recording = driven(10)
    recording.time_s[:] = np.arange(10) // 5  # a clock of whole seconds
    rates = rows_per_second(recording), mean_rate(recording), report_recordings(recording)[0].fps
    assert rates == (9.0, 9.0, 9.0)
    recording.time_s[:] = np.r_[0:5, 9:14] / 20  # four rows are missing
    assert mean_rate(recording) == pytest.approx(20)
    recording.time_s[:] = np.nan
    assert rows_per_second(recording) == 15.0


def test_seconds_to_the_nearest_training_row_are_unknown_without_times() -> None:
    recording = recording_in_memory(np.zeros(100))
    assert seconds_apart(recording, np.arange(0, 41), np.array([70])) == pytest.approx(30 / 15)
    recording.time_s[:] = np.nan
    assert np.isnan(seconds_apart(recording, np.arange(0, 41), np.array([70])))


def test_seconds_do_not_count_across_recordings() -> None:
    """Row 50 is the second recording's first: the first recording's last row is no neighbour."""
    recording = recording_in_memory(np.zeros(100), sizes=(50, 50))
    train = np.concatenate([np.arange(50), np.arange(65, 100)])
    assert seconds_apart(recording, train, np.array([50])) == pytest.approx(1.0)


def test_a_format_of_long_drives_states_longer_blocks_and_the_user_wins() -> None:
    laps = driven(9000)
    long = replace(laps, blocks=LONG_DRIVE)

    def lengths(recording, **settings) -> np.ndarray:
        part = split_rows(recording, val_share=0.2, test_share=0.0, **settings).val
        return np.diff(np.flatnonzero(np.diff(part, prepend=-9, append=99_999) > 1))

    shortest = lengths(laps).min(), lengths(long).min(), lengths(long, block_s=20).min()
    assert shortest == (150, 450, 300)
    assert "30 s with gaps of 3 s" in split_words(long, "blocks")
    assert LONG_DRIVE.why in split_words(long, "blocks")
    assert "data.block_s, at most" in split_words(long, "blocks", block_s=1e6)
    assert split_words(long, "random") == "random"


def test_several_recordings_take_the_longest_blocks(recorded, tmp_path: Path) -> None:
    drive = foreign.challenge2_test(tmp_path / "drive")
    assert read_recordings(str(recorded.folder)).blocks == SHORT_DRIVES
    assert read_recordings([str(drive), str(recorded.folder)]).blocks == LONG_DRIVE


def test_a_random_split_hides_the_error_of_slowly_changing_steering() -> None:
    slow = recording_in_memory(0.5 * np.sin(np.arange(9000) / 200))
    (line,) = leak_lines(slow)
    copied, blocks = random_split_leak(slow)
    assert copied < 0.01 < 0.05 < blocks
    assert f"{1 - copied / blocks:.0%}" in line
    noise = recording_in_memory(np.random.default_rng(0).uniform(-1, 1, 9000))
    copied, blocks = random_split_leak(noise)
    assert copied == pytest.approx(blocks, rel=0.1)


def test_the_neighbour_is_of_the_same_recording() -> None:
    steering = np.repeat([0.5, -0.5], 500)
    assert random_split_leak(recording_in_memory(steering, sizes=(500, 500))) is None
    assert random_split_leak(recording_in_memory(steering)) is not None


def test_a_recording_that_cannot_be_split_has_no_leak() -> None:
    assert leak_lines(driven(9000)) == []
    assert leak_lines(recording_in_memory([0.0, 1.0])) == []
