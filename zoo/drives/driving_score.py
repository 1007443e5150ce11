"""One number for how well was driven, by which a search compares."""

import math

from zoo.drives.interventions import INTERVENTION_S

HALF_M = 1.0  # the mean cross-track error that counts as half an intervention


def driving_score(interventions: float, driven_s: float, cte_mean_m: float) -> float:
    """Autonomy, and among those who are even in it, the nearer to the middle the better: at most 1.

    1 - 6 s x (interventions + e / (e + 1 m)) / time driven, where e is the mean cross-track error.
    That is NVIDIA's autonomy less a part of one intervention, which is below 1 however far off the
    car was: in the same time, who intervened less is ahead. It may fall below 0, where autonomy is
    held at 0, so that a search can tell bad drivers apart, too. NaN where nothing was driven.

    >>> round(driving_score(0, 60.0, 0.25), 3), round(driving_score(0, 60.0, 1.0), 3)
    (0.98, 0.95)
    >>> driving_score(1, 60.0, 0.0) < driving_score(0, 60.0, 1000.0)
    True
    """
    if driven_s <= 0:
        return math.nan
    share = cte_mean_m / (cte_mean_m + HALF_M)
    return 1 - INTERVENTION_S * (interventions + share) / driven_s
