"""The threshold of a score at a chosen rate of false alarms."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from zoo.base.errors import InputError

LEAST_WINDOWS = 20


@dataclass(frozen=True)
class Threshold:
    """A Gamma distribution of nominal windows' scores, and the threshold at a false-alarm rate.

    Attributes:
        shape: shape of the distribution.
        scale: scale of the distribution.
        false_alarms: share of nominal windows above the threshold, by the distribution.
        value: score above which a window raises an alarm.
    """

    shape: float
    scale: float
    false_alarms: float
    value: float


def fit_threshold(scores: np.ndarray, false_alarms: float) -> Threshold:
    """Fit a Gamma distribution that begins at 0 by maximum likelihood.

    Source: Stocco et al. 2020, arXiv:1910.04443, section 4.4.

    Args:
        scores: scores of nominal windows, float [N], 0 or more.
        false_alarms: share of nominal windows that may raise an alarm, between 0 and 1.

    Raises:
        InputError: there are too few scores, or all are equal.

    >>> scores = stats.gamma(3, scale=2).rvs(4000, random_state=0)
    >>> round(fit_threshold(scores, 0.05).value, 1)  # the distribution's own: 12.6
    12.4
    """
    if len(scores) < LEAST_WINDOWS:
        raise InputError(
            f"{len(scores)} nominal windows: a threshold needs {LEAST_WINDOWS} or more; drive more "
            "nominal_laps= or nominal= drives, or choose a network that fails less"
        )
    if not np.isfinite(scores).all() or np.ptp(scores) == 0:
        raise InputError("the nominal scores are all equal or not finite; leave the method out")
    positive = np.maximum(scores, 1e-12)  # the likelihood of 0 is 0
    shape, _, scale = stats.gamma.fit(positive, floc=0)
    value = float(stats.gamma.ppf(1 - false_alarms, shape, scale=scale))
    return Threshold(float(shape), float(scale), false_alarms, value)
