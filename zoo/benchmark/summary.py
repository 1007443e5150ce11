"""The figures of an entry by group, each with a 95 % interval, computed from its drives."""

import math
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from zoo.benchmark.result import DriveRecord, Interval
from zoo.benchmark.suite import LAPS, LIKE
from zoo.drives.bootstrap import Estimate, bootstrap, interquartile_mean, poisson_rate
from zoo.drives.intervals import wilson_interval

MEANS = ("autonomy", "cte_mean_m", "steering_per_s")  # figures with a bootstrapped mean
COMPARED = ("autonomy", "cte_mean_m")  # figures compared with the clean partner


def group_names(drives: Sequence[DriveRecord]) -> list[str]:
    """Return the names of the groups in the order of the drives."""
    return list(dict.fromkeys(one.group for one in drives))


def group_figures(drives: Sequence[DriveRecord]) -> dict[str, Interval]:
    """Return the figures of a group's drives.

    Returns:
        `autonomy`, `cte_mean_m` and `steering_per_s`: mean over roads and training seeds, with a
        bootstrap interval over both. `m_per_intervention`: distance divided by interventions, with
        the exact interval of a Poisson count; null without an intervention.
        `without_intervention`: share of the drives, with Wilson's interval.
    """
    found = {name: _interval(bootstrap(table(drives, name), np.mean)) for name in MEANS}
    count = sum(int(one.figures["interventions"]) for one in drives)
    driven_m = sum(max(one.figures["driven_m"], 0.0) for one in drives)
    rate = poisson_rate(count, driven_m) if driven_m else Estimate(*[math.nan] * 3)
    found["m_per_intervention"] = _interval(
        Estimate(*(1 / one if one else math.nan for one in (rate.value, rate.high, rate.low)))
    )
    kept = sum(not one.figures["interventions"] for one in drives)
    found["without_intervention"] = _interval(
        Estimate(kept / len(drives), *wilson_interval(kept, len(drives)))
    )
    return found


def headline(drives: Sequence[DriveRecord]) -> Interval:
    """Return the interquartile mean of the autonomy over all roads but the laps.

    The figure of a road is its mean over the training seeds.
    """
    roads = [one for one in drives if one.group != LAPS] or drives
    return _interval(bootstrap(table(roads, "autonomy"), _over_roads))


def differences(drives: Sequence[DriveRecord]) -> dict[str, dict[str, Interval]]:
    """Return by shifted group the mean difference of each drive to its clean partner."""
    clean = {(one.checkpoint, one.track): one for one in drives if one.group == LIKE}
    found = {}
    for group in group_names(drives):
        shifted = [one for one in drives if one.group == group and one.settings]
        if not shifted or group == LIKE:
            continue
        partners = [clean[one.checkpoint, one.track] for one in shifted]
        found[group] = {
            name: _interval(bootstrap(table(shifted, name) - table(partners, name), np.mean))
            for name in COMPARED
        }
    return found


def table(drives: Sequence[DriveRecord], name: str) -> np.ndarray:
    """Return a figure of drives, float64 [training seeds, roads]."""
    seeds = 1 + max(one.checkpoint for one in drives)
    values = [
        [float(one.figures[name]) for one in drives if one.checkpoint == number]
        for number in range(seeds)
    ]
    return np.array(values, np.float64)


def _over_roads(values: np.ndarray) -> float:
    return interquartile_mean(values.mean(axis=0))


def _interval(estimate: Estimate) -> Interval:
    known = {key: one if math.isfinite(one) else None for key, one in asdict(estimate).items()}
    return Interval(**known)
