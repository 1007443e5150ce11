"""The driving score: one number per drive, by which a sweep ranks its trials."""

import math

from zoo.drives.interventions import INTERVENTION_S

HALF_M = 1.0  # the mean cross-track error that counts as half an intervention


def driving_score(interventions: float, driven_s: float, cte_mean_m: float) -> float:
    """Return NVIDIA's autonomy less a small part for the cross-track error; at most 1.

    The score is 1 - 6 s * (interventions + e / (e + 1 m)) / driven_s, where e is the mean
    cross-track error in metres. The part e / (e + 1 m) stays below one intervention, so that over
    the same time a drive with fewer interventions always scores higher. Unlike autonomy, the score
    can fall below 0, so that a sweep can rank bad networks, too. It is NaN if no time was driven.

    >>> round(driving_score(0, 60.0, 0.25), 3), round(driving_score(0, 60.0, 1.0), 3)
    (0.98, 0.95)
    >>> driving_score(1, 60.0, 0.0) < driving_score(0, 60.0, 1000.0)
    True
    """
    if driven_s <= 0:
        return math.nan
    share = cte_mean_m / (cte_mean_m + HALF_M)
    return 1 - INTERVENTION_S * (interventions + share) / driven_s
