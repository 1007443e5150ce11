"""How well scores of a drive's frames tell those before a failure.

Scores are fitted on the fit roads, thresholds on the threshold roads, and the figures are of the
test roads.
"""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from benchmarks.board_rows import Row
from benchmarks.road_rows import columns_of
from benchmarks.study_grid import Entry, Study, kept
from benchmarks.watched_drives import (
    BEFORE_S,
    CLEAR_S,
    COLUMNS,
    EXPERT,
    WINDOW,
    Alarm,
    Frames,
    Score,
    driven,
    search_level,
)
from zoo.driving.bootstrap import Estimate
from zoo.driving.clustered import ANY, POSITIVE, SHARE, clustered

FALSE_ALARMS = 0.1  # share of the threshold roads' frames that no failure follows
FEWEST = 5  # failures of a condition that takeovers are driven for
LIMITS = {
    **dict.fromkeys(("auc", "warned", "false_alarms"), SHARE),
    "alarms_per_km": POSITIVE,
    **dict.fromkeys(("over_brightness", "over_steering", "avoided"), (-1.0, 1.0)),
    "avoided_per_km": ANY,
}

Parts = dict[str, tuple[np.ndarray, np.ndarray]]  # by figure: sums and weights of each place, [P]


def learned(drives: Sequence[Frames]) -> Score:
    """Return a logistic regression of the activations: does the car fail within 3 s?"""
    rows = np.concatenate([one.rows[:, len(COLUMNS) :] for one in drives]).astype(float)
    left_s = np.concatenate([one.left_s for one in drives])
    chosen = (left_s <= BEFORE_S[1]) | (left_s > CLEAR_S)
    rows, fails = rows[chosen], left_s[chosen] <= BEFORE_S[1]
    mean, deviation = rows.mean(0), rows.std(0) + 1e-3
    units = (rows - mean) / deviation
    shares = np.where(fails, 0.5 / max(fails.mean(), 1e-9), 0.5 / (~fails).mean()) / len(fails)

    def loss(weights: np.ndarray) -> tuple[float, np.ndarray]:
        logits = units @ weights[:-1] + weights[-1]
        slopes = shares * (expit(logits) - fails)
        value = shares @ (np.logaddexp(0, logits) - fails * logits) + 0.01 * weights @ weights
        return value, np.append(units.T @ slopes, slopes.sum()) + 0.02 * weights

    weights = minimize(loss, np.zeros(rows.shape[1] + 1), jac=True).x
    return lambda own: ((own[:, len(COLUMNS) :] - mean) / deviation) @ weights[:-1]


def alarms(
    study: Study, drives: dict[str, dict[str, list[Frames]]], condition: str
) -> dict[str, Alarm]:
    """Return each score that the network has for a condition, with its threshold."""
    mean, fit = study.values["brightness"], {name: own["fit"] for name, own in drives.items()}
    others = [one for name, own in fit.items() if name != condition for one in own]
    scores: dict[str, Score] = {
        "brightness": lambda rows: np.abs(rows[:, 0] - mean),
        **{name: lambda rows, at=at: rows[:, at] for at, name in enumerate(COLUMNS[1:4], 1)},
        "steering": lambda rows: np.abs(rows[:, 4]),
        "activations": learned([one for own in fit.values() for one in own]),
        "activations, other causes": learned(others),
        "random": lambda rows: rows[:, 5],
        "always": lambda rows: np.zeros(len(rows)),
    }
    calm = [one for own in drives.values() for one in own["threshold"]]
    found = {}
    for name, score in scores.items():
        values = np.concatenate([one.windows(score)[one.labels == 0] for one in calm])
        if np.isfinite(values).all() and (name[-6:] != "causes" or any(o.failed for o in others)):
            found[name] = Alarm(score, float(np.quantile(values, 1 - FALSE_ALARMS)))
    return found


def auc_parts(drives: Sequence[Frames], score: Score) -> tuple[np.ndarray, np.ndarray]:
    """Return sums and weights of places whose ratio is the AUC over pairs of frames of all places.

    A pair belongs to two places, so that a place's sum varies as the AUC does when the place is
    drawn again: the projection of a U-statistic, for clusters by Obuchowski 1997.
    """
    before, clear = (
        [one.windows(score)[one.labels == label] for one in drives] for label in (1, 0)
    )
    above = np.array([[(np.sign(a[:, None] - b) + 1).sum() / 2 for b in clear] for a in before])
    pairs = np.outer(*([len(one) for one in part] for part in (before, clear))).astype(float)
    auc = above.sum() / max(pairs.sum(), 1)
    sums, weights = (one.sum(0) + one.sum(1) for one in (above, pairs))
    return auc * weights / 2 + sums - auc * weights, weights / 2


def parts_of(
    drives: Sequence[Frames], alarm: Alarm, known: Mapping[str, Alarm]
) -> tuple[Parts, list[float]]:
    """Return the parts of an alarm's figures in one condition, and the leads in seconds."""
    labels = [one.labels for one in drives]
    raised = [
        (one.windows(alarm.score) >= alarm.threshold) & (np.arange(len(one.rows)) >= WINDOW - 1)
        for one in drives
    ]
    auc, pairs = auc_parts(drives, alarm.score)
    warned = np.array([(on & (own == 1)).any() for on, own in zip(raised, labels, strict=True)])
    leads = [
        one.left_s[on & (one.left_s <= CLEAR_S)].max()
        for on, one, is_warned in zip(raised, drives, warned, strict=True)
        if is_warned
    ]
    counts = {
        "warned": (warned, [(own == 1).any() for own in labels]),
        "false_alarms": (
            [(on & (own == 0)).sum() for on, own in zip(raised, labels, strict=True)],
            [(own == 0).sum() for own in labels],
        ),
        "alarms_per_km": (
            [np.diff(np.append(False, on).astype(int)).clip(0).sum() for on in raised],
            [one.metres / 1000 for one in drives],
        ),
    }
    parts = {name: tuple(np.array(one, float) for one in own) for name, own in counts.items()}
    for other in {"brightness", "steering"} - {name for name, one in known.items() if one is alarm}:
        parts[f"over_{other}"] = auc - auc_parts(drives, known[other].score)[0], pairs
    return {"auc": (auc, pairs), **parts}, leads


def network_parts(
    study: Study, entry: Entry, conditions: Sequence[str], takeovers: str
) -> dict[tuple[str, str], tuple[Parts, list, Row]]:
    """Drive what is missing of a network; return parts, leads and counts by condition and score."""
    levels = {
        name: kept(entry.folder / f"{name}.json", lambda one=name: search_level(study, entry, one))
        for name in conditions
    }
    usable = {name: one["level"] for name, one in levels.items() if 0 < one["failed"] < 1}
    drives = {
        name: {part: driven(study, entry, name, level, part) for part in ("fit", "threshold")}
        for name, level in {"clear": 0.0, **usable}.items()
    }
    found = {}
    for name, level in usable.items():
        test, known = driven(study, entry, name, level, "test"), alarms(study, drives, name)
        failed = np.array([one.failed for one in test], float)
        counts: Row = {"level": level, "drives": len(test), "failures": int(failed.sum())}
        for score, alarm in known.items():
            own, leads = parts_of(test, alarm, known)
            if score in takeovers.split(",") and failed.sum() >= FEWEST:
                handed = driven(study, entry, f"{name}-{score}", level, "test", alarm)
                avoided = failed - [one.failed for one in handed]
                given = [one.metres * one.rows[:, EXPERT].mean() / 1000 for one in handed]
                own |= {"avoided": (avoided, failed), "avoided_per_km": (avoided, np.array(given))}
            found[name, score] = own, leads, counts
    return found


def warning_rows(study: Study, entry: Entry) -> list[Row]:
    """Return rows of a network, and those of all networks whose levels are kept."""
    conditions = study.options.conditions.split(",")
    networks = {}
    for one in study.entries():
        known = [name for name in conditions if (one.folder / f"{name}.json").is_file()]
        if one == entry or known:
            own = (conditions, study.options.takeovers) if one == entry else (known, "")
            networks[one.name] = network_parts(study, one, *own)
    scores = dict.fromkeys(score for own in networks.values() for _, score in own)
    groups = {entry.name: [entry.name], "all": list(networks)}
    rows = []
    for group, condition, score in itertools.product(groups, ("all", *conditions), scores):
        cells = [
            [
                own
                for (one, other), own in networks[name].items()
                if other == score and condition in ("all", one)
            ]
            for name in groups[group]
        ]
        cells = [own for own in cells if own]
        if cells:
            place = {"network": group, "condition": condition, "group": score}
            rows.append(place | row_of(cells, study.config["roads"]["test"]))
    return rows


def row_of(cells: Sequence[Sequence[tuple[Parts, list, Row]]], roads: Sequence[str]) -> Row:
    """Return the columns of a group's networks; the figures are of their conditions together."""
    every = [cell for own in cells for cell in own]
    leads = [lead for cell in every for lead in cell[1]]
    row: Row = {
        "level": every[0][2]["level"] if len(every) == 1 else "",
        **{name: sum(cell[2][name] for cell in every) for name in ("drives", "failures")},
        "lead_s": round(float(np.median(leads)), 1) if leads else "",
    }
    for name, limits in LIMITS.items():
        found = Estimate(float("nan"))
        known = [[cell[0][name] for cell in own if name in cell[0]] for own in cells]
        if known := [own for own in known if own]:
            values, weights = (
                np.array([sum(p[side] for p in own) for own in known]) for side in (0, 1)
            )
            found = clustered(values, weights, places=roads, limits=limits)
        row |= columns_of(name, found, 3)
    return row
