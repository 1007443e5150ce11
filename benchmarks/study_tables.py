"""The tables of the studies: their cells and texts, which a study's YAML names.

A function of `CELLS` receives the rows of a line's group, all as text, and its arguments.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.carry import agreement, on_board
from benchmarks.measuring import Rows, grouped, markdown_table, write_between
from zoo.driving.intervals import count_with_interval, mean_over_seeds
from zoo.results.suite import OVERALL

NOT_MEASURED = "Not measured yet."


def floats(rows: Rows, key: str) -> list[float]:
    """Return the numbers of a column; empty cells are left out."""
    return [float(row[key]) for row in rows if row[key] != ""]


def figures(rows: Rows, form: str, *keys: str) -> str:
    """Return figures in a form: means of columns, or `least KEY`, `most KEY`; `-` without all.

    >>> figures([{"x": "0.5"}, {"x": "1"}], "{:.0%} ({:.0%})", "x", "least x")
    '75% (50%)'
    """
    values = []
    for key in keys:
        ends, _, name = key.rpartition(" ")
        if len(column := floats(rows, name)) < len(rows):
            return "-"
        values.append({"": np.mean, "least": min, "most": max}[ends](column))
    return form.format(*values)


def clean_laps(rows: Rows, key: str, label: str = "") -> str:
    """Return how many laps had no intervention, with the exact interval and its label."""
    clean = sum(row[key] != "" and not float(row[key]) for row in rows)
    return count_with_interval(clean, len(rows)).replace("95 %: ", label)


def mean_with_interval(rows: Rows, key: str) -> str:
    """Return a mean share and its 95 % interval by Student's t, in percent within 0..100.

    >>> mean_with_interval([{"x": "0.9"}, {"x": "1"}, {"x": "0.95"}], "x")
    '95.0 % (82.6 to 100.0)'
    >>> mean_with_interval([{"x": "0.9"}], "x"), mean_with_interval([{"x": ""}], "x")
    ('90.0 %', '-')
    """
    return over_seeds([100 * share for share in floats(rows, key)], 100.0, " %")


def over_seeds(values: Sequence[float], most: float, unit: str, form: str = ".1f") -> str:
    """Return a mean over training seeds with its interval, from 0 to `most`; `-` of no values."""
    if not values:
        return "-"
    mean, count = float(np.mean(values)), len(values)
    deviation = float(np.std(values, ddof=1)) if count > 1 else None
    interval = mean_over_seeds(mean, deviation, count, (0, most))
    if math.isnan(interval.low):  # all are equal, which says little about a further one
        return f"{mean:{form}}{unit}"
    return f"{mean:{form}}{unit} ({interval.low:{form}} to {interval.high:{form}})"


def by_training(rows: Rows) -> list[tuple[float, float]]:
    """Return the interventions and the kilometres of each training, in the order of the seeds."""
    by_seed = sorted(grouped(rows, ["seed"]), key=lambda drives: int(drives[0]["seed"]))
    return [
        (sum(floats(drives, "interventions")), sum(floats(drives, "driven_m")) / 1000)
        for drives in by_seed
    ]


def interventions_per_km(rows: Rows) -> str:
    """Return the mean over trainings of their interventions per km, with its interval.

    >>> row = {"seed": "1", "interventions": "2", "driven_m": "500"}
    >>> interventions_per_km([row, {**row, "interventions": "0"}])
    '2.0'
    >>> interventions_per_km([row, {**row, "seed": "2", "interventions": "1"}])
    '3.0 (0.0 to 15.7)'
    """
    return over_seeds([count / km for count, km in by_training(rows)], math.inf, "")


def clean_trainings(rows: Rows) -> str:
    """Return how many trainings drove without an intervention, with the exact interval.

    >>> row = {"seed": "1", "interventions": "1", "driven_m": "500"}
    >>> clean_trainings([row, {**row, "interventions": "0"}, {**row, "seed": "2"}])
    '0 of 2 (84 % or less)'
    """
    counts = [count for count, _ in by_training(rows)]
    return count_with_interval(counts.count(0), len(counts)).replace("95 %: ", "")


def interventions_of(rows: Rows) -> str:
    """Return the number of interventions of each training, the trainings in order.

    >>> row = {"interventions": "0", "driven_m": "500"}
    >>> interventions_of([{**row, "seed": "1"}, {**row, "seed": "10", "interventions": "3"},
    ...                   {**row, "seed": "2"}])
    '0, 0, 3'
    """
    return ", ".join(f"{count:.0f}" for count, _ in by_training(rows))


# Cells of the board, whose entries have a row for each group of roads.


def of_group(rows: Rows, group: str, figure: str) -> list[str]:
    """Return a figure of a group of roads, and its lower and upper bound; empty without one."""
    chosen = [row for row in rows if row["group"] == group]
    return [chosen[0].get(figure + end, "") if chosen else "" for end in ("", "_low", "_high")]


def number(rows: Rows, group: str, figure: str, form: str = "", scale: int = 1) -> str:
    """Return a figure with its 95 % interval; a lower bound alone where there is no value.

    >>> number([{"group": "like", "x": "", "x_low": "812.4", "x_high": ""}], "like", "x")
    '812 or more'
    >>> number([{"group": "like", "x": "0.25", "x_low": "0.2", "x_high": "0.31"}], "like", "x")
    '0.25 (0.20 to 0.31)'
    """
    value, low, high = (
        cell and f"{scale * float(cell):{form or (',.0f' if abs(float(cell)) >= 10 else ',.2f')}}"
        for cell in of_group(rows, group, figure)
    )
    if not value:
        return f"{low} or more" if low else "-"
    unit = " %" if scale == 100 else ""
    return f"{value}{unit} ({low} to {high})" if low and high else f"{value}{unit}"


def percent(rows: Rows, group: str, figure: str) -> str:
    """Return a share with its 95 % interval, in percent.

    >>> percent([{"group": "like", "x": "0.9", "x_low": "0.85", "x_high": "1.0"}], "like", "x")
    '90.0 % (85.0 to 100.0)'
    """
    return number(rows, group, figure, ".1f", 100)


def clean_drives(rows: Rows) -> str:
    """Return how many of an entry's drives but the laps had no intervention, with the interval."""
    figures = of_group(rows, OVERALL, "without_intervention")
    share, low, high = (100 * float(text) for text in figures)
    drives = int(of_group(rows, OVERALL, "drives")[0])
    return f"{round(share * drives / 100)} of {drives} ({low:.0f} to {high:.0f} %)"


# Cells of the write-ups' claims.

# What the write-ups say of a track; nothing is claimed of the others.
CLAIMS = {
    ("A", "udacity_lake"): "drives, a little rough in the first sharp turn",
    ("A", "udacity_mountain"): "drives without a fault, not trained on it",
    ("B", "udacity_lake"): "drives a lap",
    ("C", "udacity_lake", "throttle 0.2"): "drives",
    ("C", "udacity_mountain", "throttle 0.3"): "drives, not trained on it",
}


def claim(rows: Rows) -> str:
    """Return what the write-up says of a track and, if it names one, a speed control."""
    labels = rows[0]["recipe"], rows[0]["track"]
    return CLAIMS.get((*labels, rows[0]["control"])) or CLAIMS.get(labels, "-")


def stalls_or_autonomy(rows: Rows) -> str:
    """Return where drives stalled, or else the mean autonomy with its interval."""
    stalls = floats(rows, "stalled_m")
    if not stalls:
        return mean_with_interval(rows, "autonomy")
    places = " to ".join(dict.fromkeys(f"{ends(stalls):.0f}" for ends in (min, max)))
    moved = floats(rows, "autonomy")
    others = f"; the others {100 * np.mean(moved):.1f} %" if moved else ""
    return f"{len(stalls)} of {len(rows)} stall, at {places} m{others}"


def commands(rows: Rows) -> str:
    """Return the commands that train the recipes of a table, a block for each."""
    return "\n\n".join(
        f"{group[0]['setting']}:\n\n```bash\n{group[0]['command'].removesuffix(' seed=1')}\n```"
        for group in grouped(rows, ["setting"])
    )


def packaged() -> list[dict]:
    """Return the facts of the networks that come trained, the smallest first."""
    from zoo.checkpoints.checkpoint_path import packaged_names, read_facts

    packaged_names.cache_clear()  # the study may have written a new one
    rows = []
    for name in packaged_names():
        facts = read_facts(name)
        unseen = facts["drives"]["unseen"]
        row = {**facts, **facts["drives"], "name": name, "kB": facts["bytes"] / 1000}
        row["kept"] = f"{unseen['kept']} of {unseen['drives']}"
        rows.append(row)
    return sorted(rows, key=lambda row: row["parameters"])


def mean_of_trainings(rows: Rows, key: str, form: str = ".1f") -> str:
    """Return the mean over trainings of a column's mean, with its 95 % interval."""
    values = [float(np.mean(floats(training, key))) for training in grouped(rows, ["seed"])]
    return over_seeds(values, math.inf, "", form)


CELLS: dict[str, Callable[..., str]] = {
    "agreement": agreement,
    "claim": claim,
    "clean_drives": clean_drives,
    "clean_laps": clean_laps,
    "clean_trainings": clean_trainings,
    "count": lambda rows: str(len(rows)),
    "figures": figures,
    "interventions_of": interventions_of,
    "interventions_per_km": interventions_per_km,
    "mean_with_interval": mean_with_interval,
    "mean_of_trainings": mean_of_trainings,
    "number": number,
    "on_board": on_board,
    "percent": percent,
    "stalls_or_autonomy": stalls_or_autonomy,
    "text": lambda rows, form: form.format(**rows[0]) or "-",
    "trainings": lambda rows: str(len(by_training(rows))),
}


def table(spec: Mapping, rows: Rows) -> str:
    """Return a table of a study's YAML as Markdown, with what stands after it."""
    groups = grouped(rows, spec.get("group", []))
    if not groups:
        return NOT_MEASURED
    if "ascending" in spec:
        groups.sort(key=lambda group: float(group[0][spec["ascending"]]))
    head = [column[0] for column in spec["columns"]]
    lines = [
        [CELLS[cell](group, *arguments) for _, cell, *arguments in spec["columns"]]
        for group in groups
    ]
    text = markdown_table(head, lines, spec.get("left", 1))
    return f"{text}\n\n{commands(rows)}" if spec.get("commands") else text


def write_tables(specs: Sequence[Mapping], rows: Rows) -> list[Path]:
    """Write the tables of a study's YAML into their pages, and return the pages.

    A table with `each` is written for each value of that column, to the page that has its marker.
    """
    pages = []
    for spec in specs:
        shown = [
            row
            for row in rows
            if all(row[key] in values for key, values in spec.get("where", {}).items())
            and ("needs" not in spec or row[spec["needs"]])
        ]
        if "each" not in spec:
            write_between(Path(spec["page"]), spec["marker"], table(spec, shown))
            pages.append(Path(spec["page"]))
            continue
        for group in grouped(shown, [spec["each"]]):
            marker = spec["marker"].format(**group[0])
            for page in sorted(Path().glob(spec["page"])):
                if f"<!-- {marker} -->" in page.read_text():
                    write_between(page, marker, table(spec, group))
                    pages.append(page)
    return list(dict.fromkeys(pages))
