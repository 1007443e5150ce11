"""Intervals of shares and counts, the bootstrap, and the plot of both."""

import io
import math
import warnings

import numpy as np
import pytest
from scipy import stats

from zoo.driving.clustered import ANY, POSITIVE, SHARE, clustered, holm, p_value
from zoo.driving.intervals import Estimate, bootstrap, poisson_rate, share_interval
from zoo.runs.plots import interval_plot


@pytest.mark.parametrize(("successes", "trials"), [(0, 3), (3, 3), (2, 5), (70, 96), (1, 1)])
def test_the_interval_of_a_share_is_scipys(successes: int, trials: int) -> None:
    exact = stats.binomtest(successes, trials).proportion_ci(method="exact")
    assert share_interval(successes, trials) == pytest.approx((exact.low, exact.high))


@pytest.mark.parametrize("successes", [4, -1])
def test_a_count_outside_its_trials_is_refused(successes: int) -> None:
    with pytest.raises(ValueError, match=f"{successes} of 3"):
        share_interval(successes, 3)


RNG = np.random.default_rng(7)


@pytest.mark.parametrize("count", [0, 1, 3, 40])
def test_the_interval_of_a_rate_is_scipys(count: int) -> None:
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    high = stats.chi2.ppf(0.975, 2 * count + 2) / 2

    rate = poisson_rate(count, 8.0)
    assert (rate.value, rate.low, rate.high) == pytest.approx((count / 8, low / 8, high / 8))


def test_a_rate_without_exposure_is_unknown() -> None:
    assert math.isnan(poisson_rate(0, 0.0).value)
    with pytest.raises(ValueError, match="-1"):
        poisson_rate(-1, 2.0)


def test_the_bootstrap_of_many_units_is_scipys() -> None:
    values = RNG.exponential(size=200)
    theirs = stats.bootstrap((values,), np.mean, method="percentile", rng=1).confidence_interval

    ours = bootstrap(values)

    assert ours.value == pytest.approx(values.mean())
    assert ours.low == pytest.approx(theirs.low, abs=0.02)
    assert ours.high == pytest.approx(theirs.high, abs=0.02)


def test_a_bootstrap_stays_within_its_limits() -> None:
    estimate = bootstrap(np.array([0.2, 1.0, 1.0]), limits=(0, 1))

    assert (estimate.low, estimate.high) == (0, 1)


def test_a_mean_of_independent_places_has_the_interval_of_students_t() -> None:
    values = RNG.normal(size=(1, 9))
    low, high = stats.t.interval(0.95, 8, values.mean(), stats.sem(values[0]))

    mean = clustered(values, places=range(9))

    assert (mean.value, mean.low, mean.high) == pytest.approx((values.mean(), low, high))


def test_drives_of_one_place_are_one_observation() -> None:
    values = RNG.normal(size=(3, 9))
    places = [*range(9), *range(9)]

    once = clustered(values, places=places[:9])
    twice = clustered(np.tile(values, 2), places=places)

    assert (twice.low, twice.high) == pytest.approx((once.low, once.high))


def test_groups_that_differ_do_not_widen_the_interval() -> None:
    values = np.array([[0.1, 0.2, 0.3, 0.2, 0.1, 5.1, 5.2, 5.3, 5.2, 5.1]])
    groups = ["like"] * 5 + ["sharp"] * 5

    whole, strata = (clustered(values, places=range(10), groups=by) for by in (None, groups))

    assert strata.high - strata.low < (whole.high - whole.low) / 10
    groups = ["fog"] * 5 + ["fog rain"] * 5 + ["rain"] * 5
    twice = np.append(values, values[:, :5], axis=1)
    strata = clustered(twice, places=[*range(10), *range(5)], groups=groups)
    assert strata.high - strata.low < (whole.high - whole.low) / 10, "a group that two others spell"


def test_a_failure_in_a_stratum_of_two_places_leaves_an_interval_of_use() -> None:
    values = np.array([[0.0] * 7 + [0.0, 1.0]])
    groups = ["like"] * 7 + ["dynamics"] * 2

    estimate = clustered(values, places=range(9), groups=groups, limits=POSITIVE, one_failure=1.0)

    assert estimate.high < 2


def test_trainings_that_differ_widen_the_interval() -> None:
    """Seeds that differ by 1 for both entries: the variance of their difference is the sum."""
    by_seed, places = np.linspace(-1, 1, 12), range(20)
    alone = clustered(by_seed[:, None] + np.zeros(20), places=places)
    difference = by_seed[:, None, None] - by_seed[None, :, None] + np.zeros(20)
    both = clustered(difference, places=places)

    # Student's t has twice the degrees of freedom, so the ratio is a little below sqrt(2).
    assert 1.25 < (both.high - both.low) / (alone.high - alone.low) < 1.45


@pytest.mark.parametrize("limits", [SHARE, POSITIVE])
def test_no_failure_has_the_exact_bound_of_its_places(limits: tuple) -> None:
    exact = stats.binomtest(0, 30).proportion_ci(method="exact").high

    estimate = clustered(np.zeros((3, 30)), places=range(30), limits=limits, one_failure=1.0)

    assert (estimate.value, estimate.low) == (0, 0)
    assert estimate.high == pytest.approx(exact)


def test_an_entry_that_never_failed_is_not_surer_than_one_that_did() -> None:
    highs = []
    for failures in range(4):
        values = np.zeros((3, 30))
        values[0, :failures] = 1
        estimate = clustered(values, places=range(30), limits=POSITIVE, one_failure=1.0)
        highs.append(estimate.high)
        assert estimate.low <= estimate.value <= estimate.high

    assert highs[0] <= min(highs)


@pytest.mark.parametrize("values", [np.zeros((0, 4)), np.zeros((1, 0)), np.array([[0.5, np.nan]])])
def test_unknown_values_give_an_unknown_estimate(values: np.ndarray) -> None:
    estimate = clustered(values, places=range(values.shape[1]))

    assert all(map(math.isnan, (estimate.value, estimate.low, estimate.high)))


def test_equal_values_are_no_proof_that_further_places_are_equal() -> None:
    estimate = clustered(np.full((3, 8), 0.5), places=range(8), limits=(-1, 1))
    assert estimate.low < 0.5 < estimate.high
    assert math.isnan(clustered(np.full((3, 8), 0.5), places=range(8), limits=ANY).low)


def test_a_p_value_is_below_5_percent_where_the_interval_leaves_out_0() -> None:
    for difference in (np.full((2, 2, 12), 0.6), np.full((2, 2, 12), 0.2), RNG.normal(size=(1, 9))):
        places = range(difference.shape[-1])
        estimate = clustered(difference, places=places, limits=(-1, 1))
        p = p_value(difference, places, [""] * len(places))
        assert (p < 0.05) == (estimate.low > 0 or estimate.high < 0)


def test_a_correction_for_one_pair_changes_nothing() -> None:
    assert holm([]) == []
    assert holm([0.03]) == [0.03]
    assert holm([0.9, 0.04, 0.9]) == pytest.approx([1.0, 0.12, 1.0])


@pytest.mark.parametrize(
    "figures",
    [{}, {"folder/name " * 9: Estimate(0.5, 0.2, 0.8)}, {"like": Estimate(1.0, 1.0, 1.0)}],
    ids=["no row", "one row of a long name", "an interval of one point"],
)
def test_a_plot_of_few_rows_warns_of_nothing(figures: dict[str, Estimate]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plot = interval_plot(figures, "autonomy (%)", 0.0)
        plot.savefig(io.BytesIO())
    (axis,) = plot.axes
    assert [label.get_text() for label in axis.get_yticklabels()] == list(figures)
    assert axis.get_ylim() == (0.5, -0.5)
