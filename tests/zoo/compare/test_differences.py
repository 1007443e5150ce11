"""The statistics of a comparison, on drives whose true difference is known."""

import numpy as np
import pytest
from scipy import stats

from zoo.compare.differences import (
    A_BETTER,
    B_BETTER,
    CANNOT_TELL,
    probability_of_better,
    seeds_needed,
    verdict_on,
)
from zoo.drives.bootstrap import bootstrap, mean


def drawn(
    rng: np.random.Generator, difference: float, seeds: int, by_seed: float, roads: int = 20
) -> tuple[np.ndarray, np.ndarray]:
    """Return the figures of A and B; A's mean is greater by `difference`, the roads vary it."""
    shared, own = rng.normal(size=roads), 0.2 * rng.normal(size=roads)
    a, b = (
        by_seed * rng.normal(size=(seeds, 1)) + shared + 0.3 * rng.normal(size=(seeds, roads))
        for _ in range(2)
    )
    return a + own + difference, b


def verdicts(difference: float, seeds: int, by_seed: float, repetitions: int = 300) -> list[str]:
    rng = np.random.default_rng(3)
    found = []
    for _ in range(repetitions):
        a, b = drawn(rng, difference, seeds, by_seed)
        found.append(verdict_on(bootstrap(a[:, None] - b[None], mean, draws=500)))
    return found


@pytest.mark.parametrize("by_seed", [0.0, 0.5])
@pytest.mark.parametrize("seeds", [3, 6])
def test_equal_entries_are_seldom_told_apart(seeds: int, by_seed: float) -> None:
    found = verdicts(0.0, seeds, by_seed)

    assert found.count(CANNOT_TELL) / len(found) > 0.92


def test_a_great_difference_is_told_both_ways() -> None:
    assert set(verdicts(3.0, 3, 0.2, 20)) == {A_BETTER}
    assert set(verdicts(-3.0, 3, 0.2, 20)) == {B_BETTER}


def test_the_seeds_needed_decide_in_80_of_100_cases() -> None:
    # Five training seeds and 20 roads with exactly the variances of `drawn`.
    of_seeds, own = np.array([-1, -1, 0, 1, 1]), np.linspace(-1, 1, 20)
    of_seeds = of_seeds * np.sqrt(0.5**2 + 0.3**2 / 20)
    b = np.tile(of_seeds[:, None], 20)
    needed = seeds_needed(b + 0.2 * own / own.std(ddof=1) + 0.5, b)
    assert needed.reason == "seeds"

    found = verdicts(0.5, needed.seeds, 0.5)
    assert 0.7 < found.count(A_BETTER) / len(found) < 0.9


def test_a_difference_that_roads_hide_needs_more_roads() -> None:
    of_roads = np.linspace(-1, 1, 8)[None].repeat(3, 0)
    assert seeds_needed(0.1 + of_roads, 0 * of_roads).reason == "roads"


def test_no_number_is_given_for_a_tiny_difference() -> None:
    a = np.array([[-1.0], [0.0], [1.0]]).repeat(8, 1)
    assert seeds_needed(a + 0.01, a).reason == "many"


def test_the_probability_is_that_of_mann_and_whitney() -> None:
    rng = np.random.default_rng(2)
    a = rng.integers(5, size=(6, 4)).astype(float)  # with equal values
    b = rng.integers(5, size=(7, 4)).astype(float)
    shares = [stats.mannwhitneyu(a[:, road], b[:, road]).statistic / (6 * 7) for road in range(4)]

    assert probability_of_better(a, b).value == pytest.approx(np.mean(shares))
    assert probability_of_better(b, a).value == pytest.approx(1 - np.mean(shares))
