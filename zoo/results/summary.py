"""The figures of an entry by group, each with a 95 % interval, computed from its drives."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from zoo.driving.clustered import POSITIVE, SHARE, clustered
from zoo.driving.intervals import Estimate
from zoo.driving.interventions import INTERVENTION_S
from zoo.driving.metrics import METRICS
from zoo.results.levels import level_at
from zoo.results.result import BenchmarkResult, DriveRecord, Interval
from zoo.results.suite import LAPS, LIKE, OVERALL, place_of


@dataclass(frozen=True)
class Figure:
    """How a figure of a group is shown: heading, format, factor, and whether higher is better."""

    heading: str
    form: str
    factor: float = 1
    higher: bool = False


FIGURES = {
    "interventions_per_km": Figure("interventions per km", "{:,.2f}"),
    "without_intervention": Figure("drives without intervention, %", "{:.0f}", 100, True),
    "autonomy": Figure("autonomy, %", "{:.1f}", 100, True),
    "m_per_intervention": Figure("metres per intervention", "{:,.0f}", 1, True),
    "cte_mean_m": Figure("mean error, m", "{:.2f}"),
    "steering_per_s": Figure("steering change, 1/s", "{:.2f}"),
}
# Further figures of drives that have levels.
SHARES = {"falls_to_90": 0.9, "falls_to_50": 0.5}
LEVEL_FIGURES = {
    "falls_to_90": Figure("level at which 90 % are clean", "{:.1f}", 1, True),
    "falls_to_50": Figure("level at which 50 % are clean", "{:.1f}", 1, True),
    "worst_tenth_m": Figure("largest error, worst tenth, m", "{:.2f}"),
}
# Figures compared with the clean partner, with the limits of their difference.
COMPARED = {"autonomy": (-1.0, 1.0), "cte_mean_m": (-math.inf, math.inf)}


@dataclass(frozen=True)
class Summary:
    """Figures of an entry, as in `BenchmarkResult`."""

    groups: dict[str, dict[str, Interval]]
    differences: dict[str, dict[str, Interval]]

    def flat(self) -> dict[str, Interval]:
        """Return the figures by their dotted names, such as `groups.like.autonomy`."""
        return {
            f"{kind}.{group}.{name}": figure
            for kind, groups in vars(self).items()
            for group, figures in groups.items()
            for name, figure in figures.items()
        }


def known_figures(groups: Sequence[Mapping[str, object]]) -> dict[str, Figure]:
    """Return how the figures of groups are shown: `FIGURES`, and what drives with levels have."""
    levels = [key for key in LEVEL_FIGURES if all(key in group for group in groups)]
    return FIGURES | {key: LEVEL_FIGURES[key] for key in levels}


def summarize_drives(drives: Sequence[DriveRecord]) -> Summary:
    """Return the figures of an entry's drives by group, and of all but the laps."""
    groups = {group: group_figures(drives_of(drives, group)) for group in group_names(drives)}
    if roads := drives_of(drives, OVERALL):
        groups[OVERALL] = group_figures(roads)
    return Summary(groups, differences(drives))


def drives_of(drives: Sequence[DriveRecord], group: str) -> list[DriveRecord]:
    """Return the drives of a group; those of all groups but the laps for `OVERALL`."""
    return [
        drive
        for drive in drives
        if drive.group == group or (group == OVERALL and drive.group != LAPS)
    ]


def overall(result: BenchmarkResult) -> dict[str, Interval]:
    """Return the figures of all groups but the laps; of the laps where there are no others."""
    return result.groups.get(OVERALL) or next(iter(result.groups.values()))


def group_names(drives: Sequence[DriveRecord]) -> list[str]:
    """Return the names of the groups in the order of the drives."""
    return list(dict.fromkeys(drive.group for drive in drives))


def group_figures(drives: Sequence[DriveRecord]) -> dict[str, Interval]:
    """Return the figures of a group's drives, each with the interval of `clustered`.

    Returns:
        `interventions_per_km`: sum of the interventions divided by the distance;
        `m_per_intervention` is its reciprocal, null without an intervention.
        `without_intervention`: share of the drives. `autonomy`, `cte_mean_m`, `steering_per_s`, and
        metrics of the user's that all drives have: mean over drives and training seeds. A group
        of fewer than three roads has no intervals. Drives with levels have those of
        `LEVEL_FIGURES`, too: see `level_at`; `worst_tenth_m` is the mean of the largest errors in
        the worst tenth of the drives, without an interval.
    """
    names = [*("interventions", "driven_m", "driven_s", "autonomy"), "cte_mean_m", "steering_per_s"]
    of = {name: table(drives, name) for name in [*names, *outside_metrics(drives)]}
    first = [drive for drive in drives if not drive.checkpoint]
    estimate = partial(clustered, places=places_of(first), groups=[drive.group for drive in first])
    count, km = of["interventions"].size, np.maximum(of["driven_m"], 0.0) / 1000
    driven_s = of["driven_s"].sum()
    lost = min(1.0, INTERVENTION_S * count / driven_s) if driven_s else 1.0
    rate = estimate(
        of["interventions"], km, limits=POSITIVE, one_failure=count / (km.sum() or math.inf)
    )
    failed = estimate((of["interventions"] > 0) * 1.0, limits=SHARE, one_failure=1.0)
    estimates = {
        "interventions_per_km": rate,
        "without_intervention": complement(failed),
        "autonomy": complement(estimate(1 - of["autonomy"], limits=SHARE, one_failure=lost)),
        "m_per_intervention": Estimate(
            *(1000 / per_km if per_km else math.nan for per_km in (rate.value, rate.high, rate.low))
        ),
        "cte_mean_m": estimate(of["cte_mean_m"], limits=POSITIVE),
        "steering_per_s": estimate(of["steering_per_s"], limits=POSITIVE),
    }
    estimates |= {name: estimate(of[name]) for name in outside_metrics(drives)}
    if all(drive.level for drive in drives):
        estimates |= _level_figures(drives)
    return {name: _interval(value) for name, value in estimates.items()}


def _level_figures(drives: Sequence[DriveRecord]) -> dict[str, Estimate]:
    first = [drive for drive in drives if not drive.checkpoint]
    clean, largest = (table(drives, name) for name in ("interventions", "cte_max_m"))
    levels, places = [drive.level for drive in first], places_of(first)
    figures = {
        name: level_at(share, (clean == 0) * 1.0, levels, places) for name, share in SHARES.items()
    }
    worst = np.sort(largest.ravel())[-math.ceil(largest.size / 10) :]
    return figures | {"worst_tenth_m": Estimate(float(worst.mean()))}


def places_of(drives: Sequence[DriveRecord]) -> list[str]:
    """Return the place of each drive: its road, or the roads of its number at other levels."""
    return [place_of(drive.track) for drive in drives]


def outside_metrics(drives: Sequence[DriveRecord]) -> list[str]:
    """Return the metrics that are none of drivezoo's and that every drive has."""
    usual = {*METRICS.own(), "nan_frames"}
    return [
        name
        for name in drives[0].figures
        if name not in usual and all(drive.figures.get(name) is not None for drive in drives)
    ]


def differences(drives: Sequence[DriveRecord]) -> dict[str, dict[str, Interval]]:
    """Return by shifted group the mean difference of each drive to its clean partner."""
    clean = {(drive.checkpoint, drive.track): drive for drive in drives if drive.group == LIKE}
    figures = {}
    for group in group_names(drives):
        shifted = [
            drive for drive in drives if drive.group == group and drive.settings and not drive.level
        ]
        if not shifted or group == LIKE:
            continue
        partners = [clean[drive.checkpoint, drive.track] for drive in shifted]
        figures[group] = {
            name: _interval(
                clustered(
                    table(shifted, name) - table(partners, name),
                    places=[drive.track for drive in shifted if not drive.checkpoint],
                    limits=limits,
                )
            )
            for name, limits in COMPARED.items()
        }
    return figures


def table(drives: Sequence[DriveRecord], name: str) -> np.ndarray:
    """Return a figure of drives, float64 [training seeds, drives]."""
    values = [
        [drive.figures[name] for drive in drives if drive.checkpoint == number]
        for number in range(1 + max(drive.checkpoint for drive in drives))
    ]
    return np.array(values, np.float64)


def complement(share: Estimate) -> Estimate:
    """Return the share of the others."""
    return Estimate(1 - share.value, 1 - share.high, 1 - share.low)


def _interval(estimate: Estimate) -> Interval:
    numbers = asdict(estimate).items()
    return Interval(**{key: number if math.isfinite(number) else None for key, number in numbers})
