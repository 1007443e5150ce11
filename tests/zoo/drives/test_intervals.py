"""Intervals of shares and counts, the bootstrap, and the plot of both."""

import io
import math
import warnings
from dataclasses import asdict

import numpy as np
import pytest
from scipy import stats

from zoo.drives.bootstrap import (
    Estimate,
    Statistic,
    bootstrap,
    interquartile_mean,
    mean,
    poisson_rate,
)
from zoo.drives.intervals import wilson_interval
from zoo.runs.plots import interval_plot


def test_a_wider_confidence_gives_a_wider_interval() -> None:
    low, high = wilson_interval(5, 10)
    wider_low, wider_high = wilson_interval(5, 10, confidence=0.99)

    assert wider_low < low < 0.5 < high < wider_high


def test_more_trials_give_a_narrower_interval() -> None:
    assert wilson_interval(30, 30)[0] > wilson_interval(3, 3)[0]


@pytest.mark.parametrize(("successes", "trials"), [(4, 3), (-1, 3)])
def test_a_count_outside_its_trials_is_refused(successes: int, trials: int) -> None:
    with pytest.raises(ValueError, match=f"{successes} of {trials}"):
        wilson_interval(successes, trials)


RNG = np.random.default_rng(7)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 30])
def test_the_interquartile_mean_is_scipys(count: int) -> None:
    values = RNG.normal(size=(5, count))

    assert interquartile_mean(values) == pytest.approx(stats.trim_mean(values, 0.25, axis=-1))


@pytest.mark.parametrize("count", [0, 1, 3, 40])
def test_the_interval_of_a_rate_is_scipys(count: int) -> None:
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    high = stats.chi2.ppf(0.975, 2 * count + 2) / 2

    expected = (count / 8, low / 8, high / 8)
    rate = poisson_rate(count, 8.0)
    assert (rate.value, rate.low, rate.high) == pytest.approx(expected)


def test_a_rate_without_exposure_is_unknown() -> None:
    assert math.isnan(poisson_rate(0, 0.0).value)
    with pytest.raises(ValueError, match="-1"):
        poisson_rate(-1, 2.0)


def test_the_interval_of_many_roads_is_scipys() -> None:
    values = RNG.exponential(size=200)
    theirs = stats.bootstrap((values,), np.mean, method="percentile", rng=1).confidence_interval

    ours = bootstrap(values[None], mean)

    assert ours.value == pytest.approx(values.mean())
    assert ours.low == pytest.approx(theirs.low, abs=0.02)
    assert ours.high == pytest.approx(theirs.high, abs=0.02)


@pytest.mark.parametrize("statistic", [mean, interquartile_mean])
@pytest.mark.parametrize(
    ("seeds", "roads", "by_seed", "by_road", "noise"),
    [
        (3, 30, 1.0, 0.0, 0.0),  # training seeds decide
        (3, 30, 0.3, 1.0, 0.5),
        (3, 8, 0.3, 1.0, 0.5),
        (2, 30, 0.3, 1.0, 0.5),
        (1, 8, 0.0, 1.0, 0.5),  # roads alone
    ],
)
def test_95_of_100_intervals_contain_the_truth(
    statistic: Statistic, seeds: int, roads: int, by_seed: float, by_road: float, noise: float
) -> None:
    rng = np.random.default_rng(1)
    contained, repetitions = 0, 300
    for _ in range(repetitions):
        values = by_seed * rng.normal(size=(seeds, 1)) + by_road * rng.normal(size=(1, roads))
        values = values + noise * rng.normal(size=(seeds, roads))
        found = bootstrap(values, statistic, draws=500)
        contained += found.low <= 0 <= found.high

    assert 0.92 <= contained / repetitions <= 0.99


def test_the_seeds_of_two_entries_are_resampled_apart() -> None:
    """Seeds that differ by 1 for both entries: the variance of their difference is the sum."""
    by_seed = np.linspace(-1, 1, 12)
    roads = np.zeros(20)
    difference = by_seed[:, None, None] - by_seed[None, :, None] + roads
    alone = bootstrap(by_seed[:, None] + roads, mean)
    both = bootstrap(difference, mean)

    # Student's t has twice the degrees of freedom, so the ratio is a little below sqrt(2).
    assert 1.25 < (both.high - both.low) / (alone.high - alone.low) < 1.45


def test_the_same_values_give_the_same_estimate() -> None:
    values = RNG.normal(size=(3, 9))

    assert bootstrap(values, mean) == bootstrap(values, mean)
    assert bootstrap(values, mean) != bootstrap(values, mean, seed=1)


def test_a_share_stays_within_its_limits() -> None:
    found = bootstrap(np.array([[0.2, 1.0, 1.0]]), mean, limits=(0, 1))

    assert (found.low, found.high) == (0, 1)


@pytest.mark.parametrize("values", [np.zeros((0, 4)), np.zeros((1, 0)), np.array([[0.5, np.nan]])])
def test_unknown_values_give_an_unknown_estimate(values: np.ndarray) -> None:
    found = bootstrap(values, interquartile_mean)

    assert all(map(math.isnan, (found.value, found.low, found.high)))


def test_equal_values_give_an_interval_of_no_width() -> None:
    assert bootstrap(np.full((3, 8), 0.75), interquartile_mean) == Estimate(0.75, 0.75, 0.75)


def test_a_statistic_of_all_axes_is_refused() -> None:
    with pytest.raises(ValueError, match="last axis"):
        bootstrap(np.zeros((3, 8)), np.mean)


@pytest.mark.parametrize("shape", [(3, 700), (2, 3, 400)])
def test_draws_in_parts_do_not_change_the_interval(
    shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    values = np.random.default_rng(0).random(shape)
    whole = asdict(bootstrap(values, interquartile_mean, draws=500))
    monkeypatch.setattr("zoo.drives.bootstrap.MOST_VALUES", 1000)
    parts = asdict(bootstrap(values, interquartile_mean, draws=500))
    assert parts == pytest.approx(whole)


@pytest.mark.parametrize(
    "figures",
    [{}, {"like": Estimate(0.5, 0.2, 0.8)}, {"like": Estimate(1.0, 1.0, 1.0)}],
    ids=["no row", "one row", "an interval of one point"],
)
def test_a_plot_of_few_rows_warns_of_nothing(figures: dict[str, Estimate]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plot = interval_plot(figures, "autonomy (%)", 0.0)
        plot.savefig(io.BytesIO())
    (axis,) = plot.axes
    assert [one.get_text() for one in axis.get_yticklabels()] == list(figures)
    assert axis.get_ylim() == (0.5, -0.5)
