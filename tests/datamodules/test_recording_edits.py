"""Edits of a recording: stretches that are dropped or mirrored, parts, and how users type them."""

import numpy as np
import pytest

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
from zoo.base.errors import UsageError

TEN = Edits(10)


def rows_of(edits: Edits) -> list[list[int]]:
    return [rows.tolist() for rows, _ in edits.parts()]


def test_dropping_leaves_out_rows_and_keeps_the_numbers_of_the_others() -> None:
    edits = drop(drop(TEN, (2, 4)), (3, 6))
    assert edits.dropped == ((2, 6),)
    assert rows_of(edits) == [[0, 1, 6, 7, 8, 9]]
    assert TEN.dropped == (), "the edits before stay, for undo"


def test_restoring_undoes_dropping_and_mirroring_of_a_stretch() -> None:
    edits = restore(mirror(drop(TEN, (0, 5)), (0, 5)), (1, 2))
    assert edits.dropped == edits.mirrored == ((0, 1), (2, 5))


def test_trimming_leaves_out_what_is_outside() -> None:
    assert rows_of(trim(TEN, (3, 6))) == [[3, 4, 5]]
    assert trim(TEN, (0, 10)) == TEN


def test_mirrored_rows_follow_the_others() -> None:
    ((rows, mirrored),) = mirror(TEN, (2, 4)).parts()
    assert rows.tolist() == [0, 1, 4, 5, 6, 7, 8, 9, 2, 3]
    assert np.flatnonzero(mirrored).tolist() == [8, 9]


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
        with pytest.raises(UsageError, match=r"1\.\.10"):
            edit(TEN, stretch)


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


@pytest.mark.parametrize("text", ["", "a", "1-2-3", "-3", "1.5", "²"])
def test_what_is_no_stretch_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"drop=.*120-180"):
        parse_stretches("drop", text, 10)


@pytest.mark.parametrize("text", ["0", "11", "5-3", "9-11"])
def test_rows_that_do_not_exist_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match=rf"drop={text}: .*1\.\.10"):
        parse_stretches("drop", text, 10)
