"""The threshold of a score at a false-alarm rate."""

import numpy as np
import pytest
from scipy import stats

from zoo.base.errors import InputError
from zoo.monitor.scores import fit_threshold


@pytest.mark.parametrize("rate", [0.01, 0.05, 0.3])
def test_the_share_above_the_threshold_is_the_chosen_rate(rate: float) -> None:
    scores = stats.gamma(2, scale=0.3).rvs(20_000, random_state=1)
    found = fit_threshold(scores, rate)
    assert (scores > found.value).mean() == pytest.approx(rate, rel=0.1)
    assert (found.shape, found.scale) == pytest.approx((2, 0.3), rel=0.1)


def test_scores_of_0_can_be_fitted() -> None:
    assert np.isfinite(fit_threshold(np.array([0.0, *np.linspace(1, 2, 40)]), 0.05).value)


@pytest.mark.parametrize("scores", [np.ones(30), np.arange(5.0), np.full(30, np.nan)])
def test_too_few_or_equal_scores_are_one_line(scores: np.ndarray) -> None:
    with pytest.raises(InputError, match="nominal"):
        fit_threshold(scores, 0.05)
