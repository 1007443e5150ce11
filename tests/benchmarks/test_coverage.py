"""How often the benchmark's intervals contain the truth, on drives as networks have them."""

import pytest

from benchmarks.coverage import Drives, contained, told_apart


@pytest.mark.parametrize(
    "case", [Drives(1, 0.5, 0.3), Drives(3, 0.5, 0.3), Drives(3, 0.2, 0.2), Drives(5, 0.2, 0.2)]
)
def test_95_of_100_intervals_of_clustered_counts_contain_the_truth(case: Drives) -> None:
    """Counts whose variance is two to four times their mean, most of them 0."""
    (share,) = contained(case, {"interventions": case.mean}, 700)

    assert 0.93 <= share <= 0.97


def test_the_methods_for_independent_drives_contain_it_too_seldom() -> None:
    case = Drives(3, 0.5, 0.3)
    truths = {"Garwood": case.mean, "bootstrap over drives": case.mean}

    assert max(contained(case, truths, 200)) < 0.9


def test_equal_entries_are_seldom_told_apart() -> None:
    assert told_apart(Drives(3, 0.5, 0.3), 400) <= 0.05
