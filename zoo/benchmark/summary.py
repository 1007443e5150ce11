"""The figures of an entry by group, each with a 95 % interval, computed from its drives."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from zoo.benchmark.result import DriveRecord, Interval
from zoo.benchmark.suite import LAPS, LIKE
from zoo.drives.bootstrap import (
    FEWEST_ROADS,
    Estimate,
    Statistic,
    bootstrap,
    interquartile_mean,
    mean,
    poisson_rate,
)
from zoo.drives.intervals import wilson_interval
from zoo.drives.interventions import INTERVENTION_S
from zoo.drives.metrics import METRICS


@dataclass(frozen=True)
class Figure:
    """How a figure of a group is shown: heading, format, factor, and whether higher is better."""

    heading: str
    form: str
    factor: float = 1
    higher: bool = False


FIGURES = {
    "autonomy": Figure("autonomy, %", "{:.1f}", 100, True),
    "m_per_intervention": Figure("metres per intervention", "{:,.0f}", 1, True),
    "cte_mean_m": Figure("mean error, m", "{:.2f}"),
    "steering_per_s": Figure("steering change, 1/s", "{:.2f}"),
    "without_intervention": Figure("drives without intervention, %", "{:.0f}", 100, True),
}
MIDDLE = 0.5  # share of the roads in an interquartile mean
# Figures compared with the clean partner, with the limits of their difference.
COMPARED = {"autonomy": (-1.0, 1.0), "cte_mean_m": (-math.inf, math.inf)}


@dataclass(frozen=True)
class Summary:
    """Figures of an entry, as in `BenchmarkResult`."""

    groups: dict[str, dict[str, Interval]]
    differences: dict[str, dict[str, Interval]]
    headline: Interval

    def flat(self) -> dict[str, Interval]:
        """Return the figures by their dotted names, such as `groups.like.autonomy`."""
        by_name = {"headline": self.headline}
        for kind in ("groups", "differences"):
            for group, figures in getattr(self, kind).items():
                by_name |= {f"{kind}.{group}.{name}": one for name, one in figures.items()}
        return by_name


def summarize_drives(drives: Sequence[DriveRecord]) -> Summary:
    """Return all figures of an entry's drives."""
    groups = {
        group: group_figures([one for one in drives if one.group == group])
        for group in group_names(drives)
    }
    return Summary(groups, differences(drives), headline(drives))


def group_names(drives: Sequence[DriveRecord]) -> list[str]:
    """Return the names of the groups in the order of the drives."""
    return list(dict.fromkeys(one.group for one in drives))


def group_figures(drives: Sequence[DriveRecord]) -> dict[str, Interval]:
    """Return the figures of a group's drives.

    Returns:
        `autonomy`, `cte_mean_m` and `steering_per_s`: mean over roads and training seeds, with a
        bootstrap interval over both; see also `_autonomy`. `m_per_intervention`: distance divided
        by interventions, with the exact interval of a Poisson count; null without an intervention.
        `without_intervention`: share of the drives, with Wilson's interval. A metric of the user's
        that all drives have: as `cte_mean_m`. A group of fewer than three roads has no intervals.
    """
    found = {"autonomy": _autonomy(drives, mean, 1.0)}
    for name in ("cte_mean_m", "steering_per_s"):
        found[name] = _interval(bootstrap(table(drives, name), mean, limits=(0, math.inf)))
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
    for name in outside_metrics(drives):
        found[name] = _interval(bootstrap(table(drives, name), mean))
    if table(drives, "autonomy").shape[1] < FEWEST_ROADS:
        return {name: Interval(value=one.value, low=None, high=None) for name, one in found.items()}
    return found


def outside_metrics(drives: Sequence[DriveRecord]) -> list[str]:
    """Return the metrics that are none of drivezoo's and that every drive has."""
    known = {*METRICS.own(), "nan_frames"}
    return [
        name
        for name in drives[0].figures
        if name not in known and all(one.figures.get(name) is not None for one in drives)
    ]


def headline(drives: Sequence[DriveRecord]) -> Interval:
    """Return the interquartile mean of the autonomy over all roads but the laps.

    The figure of a road is its mean over the training seeds.
    """
    roads = [one for one in drives if one.group != LAPS] or drives
    return _autonomy(roads, interquartile_mean, MIDDLE)


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
            name: _interval(
                bootstrap(table(shifted, name) - table(partners, name), mean, limits=limits)
            )
            for name, limits in COMPARED.items()
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


def _autonomy(drives: Sequence[DriveRecord], statistic: Statistic, share: float) -> Interval:
    """Return a statistic of the autonomy with a bootstrap interval.

    Drives without an intervention do not differ, and a bootstrap of them has no width. Their lower
    bound is that of the exact interval of no intervention in the time that they took.

    Args:
        drives: drives of all training seeds.
        statistic: reduces the last axis, such as `mean`.
        share: share of the roads that the statistic looks at, 0..1.
    """
    found = bootstrap(table(drives, "autonomy"), statistic, limits=(0, 1))
    if found.value == 1 and not found.low < 1:
        kept_s = sum(one.figures["driven_s"] for one in drives if not one.figures["interventions"])
        most_per_s = poisson_rate(0, share * kept_s).high
        found = Estimate(1.0, max(0.0, 1 - INTERVENTION_S * most_per_s), 1.0)
    return _interval(found)


def _interval(estimate: Estimate) -> Interval:
    known = {key: one if math.isfinite(one) else None for key, one in asdict(estimate).items()}
    return Interval(**known)
