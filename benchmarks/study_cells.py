"""The cells and texts of the studies' tables, which a study's YAML names.

A function of `CELLS` receives the rows of a line's group, all as text, and its arguments.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.rank_correlations import recoveries, test_rows
from benchmarks.study_lines import Rows, grouped
from zoo.drives.bootstrap import mean_over_seeds
from zoo.drives.intervals import count_with_interval

NOT_MEASURED = "Not measured yet."


def floats(rows: Rows, key: str) -> list[float]:
    """Return the numbers of a column; empty cells are left out."""
    return [float(row[key]) for row in rows if row[key] != ""]


def text(rows: Rows, key: str) -> str:
    return rows[0][key] or "-"


def means(rows: Rows, form: str, *keys: str) -> str:
    return form.format(*(np.mean(floats(rows, key)) for key in keys))


def mean_and_worst(rows: Rows, key: str) -> str:
    """Return the mean share and, in brackets, the smallest."""
    return f"{np.mean(floats(rows, key)):.1%} ({min(floats(rows, key)):.1%})"


def mean_and_largest(rows: Rows, mean: str, largest: str) -> str:
    return f"{np.mean(floats(rows, mean)):.2f}, {max(floats(rows, largest)):.2f}"


def duration(rows: Rows, key: str) -> str:
    """Return the mean duration; `-` for runs that were resumed after their last epoch."""
    seconds = float(np.mean(floats(rows, key)))
    if not seconds:
        return "-"
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def clean_laps(rows: Rows, key: str, label: str = "") -> str:
    """Return how many laps had no intervention, with Wilson's interval and its label."""
    clean = sum(row[key] != "" and not float(row[key]) for row in rows)
    return count_with_interval(clean, len(rows)).replace("95 %: ", label)


def mean_with_interval(rows: Rows, key: str) -> str:
    """Return a mean share and its 95 % interval by Student's t, in percent within 0..100.

    >>> mean_with_interval([{"x": "0.9"}, {"x": "1"}, {"x": "0.95"}], "x")
    '95.0 % (82.6 to 100.0)'
    >>> mean_with_interval([{"x": "0.9"}], "x"), mean_with_interval([{"x": ""}], "x")
    ('90.0 %', '-')
    """
    percents = [100 * share for share in floats(rows, key)]
    if not percents:
        return "-"
    mean, count = float(np.mean(percents)), len(percents)
    if count < 2:
        return f"{mean:.1f} %"
    interval = mean_over_seeds(mean, float(np.std(percents, ddof=1)), count, (0, 100))
    low, high = (mean, mean) if math.isnan(interval.low) else (interval.low, interval.high)
    return f"{mean:.1f} % ({low:.1f} to {high:.1f})"


# Cells of the board, whose entries have a row for each group of roads.


def of_group(rows: Rows, group: str, figure: str) -> list[str]:
    """Return a figure of a group of roads, and its lower and upper bound; empty without one."""
    found = [row for row in rows if row["group"] == group]
    return [found[0][figure + bound] if found else "" for bound in ("", "_low", "_high")]


def trained(rows: Rows, key: str) -> str:
    """Return a whole number; `-` for a baseline, which is not trained."""
    return f"{int(rows[0][key]):,}" if rows[0]["training"] else "-"


def share(rows: Rows, group: str, figure: str) -> str:
    value, *_ = of_group(rows, group, figure)
    return f"{100 * float(value):.1f} %" if value else "-"


def percent(rows: Rows, group: str, figure: str) -> str:
    """Return a share with its 95 % interval, in percent.

    >>> percent([{"group": "like", "x": "0.9", "x_low": "0.85", "x_high": "1.0"}], "like", "x")
    '90.0 % (85.0 to 100.0)'
    """
    value, low, high = of_group(rows, group, figure)
    bounds = f" ({100 * float(low):.1f} to {100 * float(high):.1f})" if low and high else ""
    return share(rows, group, figure) + (bounds if value else "")


def number(rows: Rows, group: str, figure: str) -> str:
    """Return a figure with its 95 % interval; a lower bound alone where there is no value.

    >>> number([{"group": "like", "x": "", "x_low": "812.4", "x_high": ""}], "like", "x")
    '812 or more'
    >>> number([{"group": "like", "x": "0.25", "x_low": "0.2", "x_high": "0.31"}], "like", "x")
    '0.25 (0.20 to 0.31)'
    """
    value, low, high = (
        cell and f"{float(cell):,.{0 if abs(float(cell)) >= 10 else 2}f}"
        for cell in of_group(rows, group, figure)
    )
    if not value:
        return f"{low} or more" if low else "-"
    return f"{value} ({low} to {high})" if low and high else value


def clean_drives(rows: Rows) -> str:
    """Return how many of an entry's drives had no intervention, with Wilson's interval."""
    counts = [
        (float(row["without_intervention"]), int(row["drives"]))
        for row in rows
        if row["group"] != "headline"
    ]
    clean = sum(round(share * drives) for share, drives in counts)
    return count_with_interval(clean, sum(drives for _, drives in counts)).replace("95 %: ", "")


def headline(rows: Rows) -> float:
    """Return an entry's interquartile mean of the autonomy."""
    return float(of_group(rows, "headline", "autonomy")[0])


def best_of_network(entries: Sequence[Rows]) -> list[Rows]:
    """Return the first entry of each network."""
    best: dict[str, Rows] = {}
    for entry in entries:
        best.setdefault(entry[0]["network"], entry)
    return list(best.values())


# Cells of the write-ups' claims.

DATA = {"expert": "expert, `udacity_lake`", "real": "real recording"}
# What the write-ups say of a track; nothing is claimed of the others.
CLAIMS = {
    ("A", "udacity_lake"): "drives, a little rough in the first sharp turn",
    ("A", "udacity_jungle"): "drives without a fault, not trained on it",
    ("B", "udacity_lake"): "drives a lap",
    ("C", "udacity_lake", "throttle 0.2"): "drives",
    ("C", "udacity_jungle", "throttle 0.3"): "drives, not trained on it",
}


def claim(rows: Rows) -> str:
    """Return what the write-up says of a track and, if it names one, a speed control."""
    place = rows[0]["recipe"], rows[0]["track"]
    return CLAIMS.get((*place, rows[0]["control"])) or CLAIMS.get(place, "-")


def claim_recipe(rows: Rows) -> str:
    weights = f", {rows[0]['weights']}" if rows[0]["weights"] else ""
    return f"{rows[0]['recipe']}: `{rows[0]['experiment']}`{weights}"


def stalls_or_autonomy(rows: Rows) -> str:
    """Return where drives stalled, or else the mean autonomy with its interval."""
    stalls = floats(rows, "stalled_m")
    if not stalls:
        return mean_with_interval(rows, "autonomy")
    places = " to ".join(dict.fromkeys(f"{ends(stalls):.0f}" for ends in (min, max)))
    moved = floats(rows, "autonomy")
    others = f"; the others {100 * np.mean(moved):.1f} %" if moved else ""
    return f"{len(stalls)} of {len(rows)} stall, at {places} m{others}"


def of_laps(rows: Rows, ends: str, key: str) -> str:
    """Return the mean or largest value of a column; `-` where drives stalled."""
    if floats(rows, "stalled_m"):
        return "-"
    value = {"mean": np.mean, "largest": max}[ends](floats(rows, key))
    return f"{value:.2f}"


def frame_rates(rows: Rows) -> str:
    """Return the image of the plot by frame rate, which needs two rates."""
    if len({row["frame_rate"] for row in rows}) < 2:
        return NOT_MEASURED
    return "![autonomy by frame rate](claims_frame_rate.png)"


# Cells of the study of ImageNet weights.


def relative_errors(rows: Rows) -> list[float]:
    """Return each training's balanced validation error, over that of always steering 0."""
    return [float(row["val_balanced_mae"]) / float(row["val_zero_balanced_mae"]) for row in rows]


def share_of_rows(rows: Rows) -> str:
    return f"{100 * float(rows[0]['share']):.0f} % ({int(rows[0]['train_rows']):,})"


def largest_group(rows: Rows) -> Rows:
    """Return the trainings with the most samples and a size of view: others are not compared."""
    groups = grouped(rows, ["samples", "size"])
    return max(groups, key=lambda group: (int(group[0]["samples"]), len(group)))


def count_of(count: int, noun: str) -> str:
    """Return a count with its noun.

    >>> count_of(1, "seed"), count_of(2, "seed")
    ('1 seed', '2 seeds')
    """
    return f"{count} {noun}{'s' * (count != 1)}"


def transfer_text(rows: Rows) -> str:
    """Return what was run, which trainings and drives are missing, and the figure."""
    first, seeds = rows[0], max(int(row["seed"]) for row in rows)
    laps = sorted({float(row["laps"]) for row in rows if row["laps"]})
    done = {(row["setting"], row["share"], int(row["seed"])) for row in rows}
    untrained = [
        f"{setting}, {100 * float(share):.0f} %, seed {seed}"
        for seed in range(1, seeds + 1)
        for share in ("0.1", "0.3", "1.0")
        for setting in ("scratch", "frozen random", "frozen ImageNet", "fine-tuned ImageNet")
        if (setting, share, seed) not in done
    ]
    drives = [row[f"udacity_{track}_autonomy"] for row in rows for track in ("lake", "jungle")]
    parts = [
        f"{len(rows)} trainings of {int(first['samples']):,} samples each, view "
        f"{first['size'].replace('x', ' x ')}, {count_of(seeds, 'training seed')}."
    ]
    if laps:
        parts.append(f"Each drive has {' or '.join(f'{lap:g}' for lap in laps)} laps.")
    if untrained:
        parts.append(f"Not trained: {'; '.join(untrained)}.")
    if undriven := drives.count(""):
        parts.append(f"Not driven: {undriven} of {len(drives)} drives.")
    return f"{' '.join(parts)}\n\n![what ImageNet weights help](../transfer.png)"


def commands(rows: Rows) -> str:
    """Return the commands that train the recipes of a table, as a block."""
    lines = [
        f"# {group[0]['setting']}\n{group[0]['command'].removesuffix(' seed=1')}"
        for group in grouped(rows, ["setting"])
    ]
    return "\n".join(["```bash", *lines, "```"])


def packaged() -> list[dict[str, str]]:
    """Return the rows of the networks that come trained, the smallest first."""
    from zoo.checkpoints.checkpoint_path import packaged_names, read_facts

    rows = []
    facts = [read_facts(name) | {"name": name} for name in packaged_names()]
    for network in sorted(facts, key=lambda network: network["parameters"]):
        lake, unseen = network["drives"]["lake"], network["drives"]["unseen"]
        value, low, high = (100 * unseen["headline"][key] for key in ("value", "low", "high"))
        rows.append(
            {
                "network": network["name"],
                "parameters": str(network["parameters"]),
                "file": f"{network['bytes'] / 1000:,.0f} kB",
                "laps": f"{lake['kept']} of {lake['drives']}",
                "lake_autonomy": f"{lake['autonomy']:.1%}",
                "lake_error": f"{lake['cte_mean_m']:.2f}",
                "unseen_kept": count_with_interval(unseen["kept"], unseen["drives"]),
                "unseen_autonomy": f"{value:.1f} % ({low:.1f} to {high:.1f})",
            }
        )
    return rows


CELLS: dict[str, Callable[..., str]] = {
    "claim": claim,
    "claim_data": lambda rows: DATA[rows[0]["data"]],
    "claim_recipe": claim_recipe,
    "clean_drives": clean_drives,
    "clean_laps": clean_laps,
    "code": lambda rows, key: f"`{rows[0][key]}`",
    "count": lambda rows: str(len(rows)),
    "duration": duration,
    "mean_and_largest": mean_and_largest,
    "mean_and_worst": mean_and_worst,
    "mean_with_interval": mean_with_interval,
    "means": means,
    "number": number,
    "of_laps": of_laps,
    "percent": percent,
    "relative_error": lambda rows: f"{np.mean(relative_errors(rows)):.2f}",
    "share": share,
    "share_of_rows": share_of_rows,
    "stalls_or_autonomy": stalls_or_autonomy,
    "text": text,
    "trained": trained,
}
CHOICES: dict[str, Callable[[Sequence[Rows]], list[Rows]]] = {
    "best_of_network": best_of_network,
    "by_headline": lambda entries: sorted(entries, key=lambda rows: -headline(rows)),
}
LARGEST: dict[str, Callable[[Rows], Rows]] = {"largest_group": largest_group}
TEXTS: dict[str, Callable[[Rows], str]] = {
    "commands": commands,
    "frame_rates": frame_rates,
    "recoveries": recoveries,
    "test_rows": test_rows,
    "transfer": transfer_text,
}
