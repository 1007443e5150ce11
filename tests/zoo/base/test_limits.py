"""Limits: a count above its limit is named with its place, the limit and a remedy."""

import pytest

from zoo.base.errors import InputError
from zoo.base.limits import FREE_BYTES, MOST, MOST_RATIO, check_most, check_unpacked


def test_a_larger_count_is_named_with_its_place_and_the_remedy() -> None:
    check_most("rows", MOST["rows"], "a.csv")
    with pytest.raises(InputError, match=r"^a\.csv: .*1,000,001 rows.* 1,000,000 .*; split it$"):
        check_most("rows", MOST["rows"] + 1, "a.csv", "split it")


def test_a_compressed_file_may_hold_several_times_its_bytes() -> None:
    check_unpacked(FREE_BYTES + MOST_RATIO * 1000, 1000, "a.parquet")
    with pytest.raises(InputError, match=r"^a\.parquet: .*decompression"):
        check_unpacked(FREE_BYTES + MOST_RATIO * 1000 + 1, 1000, "a.parquet")
