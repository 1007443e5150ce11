"""The tables and the page of the board, from `docs/benchmark.csv`."""

import csv
import math
from pathlib import Path

from benchmarks.csv_table import write_table
from benchmarks.marked_page import markdown_table, write_between
from zoo.drives.intervals import count_with_interval

CSV, PAGE, README = Path("docs/benchmark.csv"), Path("docs/benchmark.md"), Path("README.md")
SORTS = Path("docs/_static/board.html")
DATA = "bench_v1"  # training data of all entries, conf/data/bench_v1.yaml
BEGIN, END = "<!-- board -->", "<!-- end of board -->"
ERRORS_BEGIN, ERRORS_END = "<!-- errors -->", "<!-- end of errors -->"
GROUPS = ("like", "sharp", "looks", "dynamics", "laps")
HEADLINE = "headline"  # a line's `group` for the interquartile mean over the roads
FIGURES = (
    "autonomy",
    "m_per_intervention",
    "without_intervention",
    "cte_mean_m",
    "steering_per_s",
)
BOUNDS = ("", "_low", "_high")
CLEAN = "drives without intervention (95 %)"
NOTHING = "Not measured yet."

Row = dict[str, str]


def csv_rows(folder: Path, name: str, training: str, command: str) -> list[Row]:
    """Return the lines of an entry: its headline, then a line for each group.

    Args:
        folder: folder with the `result.json`.
        name: name of the entry.
        training: `whole`, `quick` or `submitted`; empty for a baseline.
        command: command that trains it, without the seed.

    Raises:
        InputError: the file is damaged, or of another version.
    """
    from zoo.benchmark.checked_result import read_result

    result = read_result(folder)
    first = result.checkpoints[0]
    trained_on = dict.fromkeys(one.data for one in result.checkpoints)
    entry = {
        "entry": name,
        "training": training,
        "network": first.model,
        "parameters": str(first.parameters),
        "training_seeds": str(len(result.checkpoints)),
        "suite": result.suite,
        "roads": result.roads,
        "data": " ".join(trained_on),
        "code": str(result.code.get("hash")),
        "digest": result.digest,
        "command": command,
    }
    groups = {HEADLINE: {"autonomy": result.headline}, **result.groups}
    rows = []
    for group, figures in groups.items():
        roads = [one for one in result.drives if one.group != "laps"]  # the headline's
        row = entry | {"group": group, "drives": str(len(result.of_group(group) or roads))}
        for figure in FIGURES:
            found = figures.get(figure)
            for bound, key in zip(BOUNDS, ("value", "low", "high"), strict=True):
                value = getattr(found, key) if found else None
                row[figure + bound] = "" if value is None else f"{value:.4f}"
        rows.append(row)
    return rows


def merge(rows: list[Row]) -> list[Row]:
    """Return the lines of `docs/benchmark.csv` with an entry's new lines in place of its old ones.

    Lines of other roads than the new ones are left out: they cannot be compared.
    """
    new = {(row["entry"], row["training"]) for row in rows}
    kept = [
        row
        for row in read_csv()
        if (row["entry"], row["training"]) not in new and row["roads"] == rows[0]["roads"]
    ]
    return sorted(kept + rows, key=lambda row: (row["entry"], row["training"]))


def read_csv() -> list[Row]:
    """Return the lines of `docs/benchmark.csv`, all as text; none where it does not exist."""
    if not CSV.is_file():
        return []
    with CSV.open(newline="") as file:
        return list(csv.DictReader(file))


def write_csv(rows: list[Row]) -> None:
    """Write `docs/benchmark.csv`."""
    write_table(CSV, rows)


def ranked(rows: list[Row]) -> list[dict[str, Row]]:
    """Return each entry's lines by group, the best headline first."""
    found: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        found.setdefault((row["entry"], row["training"]), {})[row["group"]] = row
    return sorted(found.values(), key=lambda entry: -float(entry[HEADLINE]["autonomy"]))


def write_pages(rows: list[Row]) -> list[Path]:
    """Write the tables between the markers of the pages, and the page that sorts.

    Args:
        rows: lines of `docs/benchmark.csv`, as text.
    """
    board = ranked(rows)
    write_between(PAGE, BEGIN, END, autonomy_table(board) if board else NOTHING)
    write_between(PAGE, ERRORS_BEGIN, ERRORS_END, errors_table(board) if board else NOTHING)
    write_between(README, BEGIN, END, short_table(board) if board else NOTHING)
    return [PAGE, README, write_sorting_page(board)]


def autonomy_table(board: list[dict[str, Row]]) -> str:
    """Return a line for each entry: the headline, and the autonomy in each group."""
    head = ["entry", "training", "parameters", "seeds", "headline (95 %)", *GROUPS, CLEAN]
    rows = [
        [
            *_names(entry),
            percent(entry[HEADLINE], "autonomy"),
            *(percent(entry.get(group), "autonomy") for group in GROUPS),
            clean_drives(entry),
        ]
        for entry in board
    ]
    return markdown_table(head, rows, left=2)


def errors_table(board: list[dict[str, Row]]) -> str:
    """Return a line for each entry: what else was measured, in the two groups of clean roads."""
    groups = ("like", "sharp")
    heads = ("m per intervention", "drives without", "mean error, m", "steering change, 1/s")
    figures = ("m_per_intervention", "without_intervention", "cte_mean_m", "steering_per_s")
    head = ["entry", "training", *(f"{group}: {one}" for group in groups for one in heads)]
    rows = []
    for entry in board:
        cells = [
            percent(entry.get(group), one) if "without" in one else number(entry.get(group), one)
            for group in groups
            for one in figures
        ]
        rows.append([*_names(entry)[:2], *cells])
    return markdown_table(head, rows, left=2)


def short_table(board: list[dict[str, Row]]) -> str:
    """Return a line for the best entry of each network, and for each baseline."""
    head = ["network", "entry", "parameters", "headline (95 %)"]
    head += [*GROUPS[:-1], CLEAN]
    best: dict[str, dict[str, Row]] = {}
    for entry in board:
        best.setdefault(entry[HEADLINE]["network"], entry)
    rows = [
        [
            network,
            _names(entry)[0],
            _names(entry)[2],
            percent(entry[HEADLINE], "autonomy"),
            *(percent(entry.get(group), "autonomy", bounds=False) for group in GROUPS[:-1]),
            clean_drives(entry),
        ]
        for network, entry in best.items()
    ]
    return markdown_table(head, rows, left=2)


def _names(entry: dict[str, Row]) -> list[str]:
    row = entry[HEADLINE]
    trained = row["training"] != ""
    return [
        f"`{row['entry']}`",
        row["training"] or "-",
        f"{int(row['parameters']):,}" if trained else "-",
        row["training_seeds"] if trained else "-",
    ]


def clean_drives(entry: dict[str, Row]) -> str:
    """Return how many of an entry's drives had no intervention, with Wilson's interval."""
    groups = [row for group, row in entry.items() if group != HEADLINE]
    counts = [(float(row["without_intervention"]), int(row["drives"])) for row in groups]
    clean = sum(round(share * drives) for share, drives in counts)
    text = count_with_interval(clean, sum(drives for _, drives in counts))
    return text.replace("95 %: ", "")


def percent(row: Row | None, figure: str, bounds: bool = True) -> str:
    """Return a share with its 95 % interval, in percent.

    >>> percent({"x": "0.9", "x_low": "0.85", "x_high": "1.0"}, "x")
    '90.0 % (85.0 to 100.0)'
    """
    if row is None or not row[figure]:
        return "-"
    value, low, high = (float(row[figure + one] or math.nan) for one in BOUNDS)
    text = f"{100 * value:.1f} %"
    if not bounds or math.isnan(low) or math.isnan(high):
        return text
    return f"{text} ({100 * low:.1f} to {100 * high:.1f})"


def number(row: Row | None, figure: str) -> str:
    """Return a figure with its 95 % interval; a lower bound alone where there is no value.

    >>> number({"x": "", "x_low": "812.4", "x_high": ""}, "x")
    '812 or more'
    >>> number({"x": "0.25", "x_low": "0.2", "x_high": "0.31"}, "x")
    '0.25 (0.20 to 0.31)'
    """
    if row is None:
        return "-"
    value, low, high = (_short(row[figure + one]) for one in BOUNDS)
    if not value:
        return f"{low} or more" if low else "-"
    return f"{value} ({low} to {high})" if low and high else value


def _short(text: str) -> str:
    return (
        ""
        if not text
        else f"{float(text):,.0f}"
        if abs(float(text)) >= 10
        else f"{float(text):.2f}"
    )


def write_sorting_page(board: list[dict[str, Row]]) -> Path:
    """Write the board as one self-contained HTML page whose columns sort, and return its path."""
    from zoo.leaderboard.ranking_page import render_page

    figures = [(HEADLINE, "autonomy"), *((group, "autonomy") for group in GROUPS)]
    figures += [(group, one) for group in GROUPS for one in FIGURES[1:]]
    heads = [("entry", True), ("training", True), ("network", True)]
    heads += [("parameters", False), ("training seeds", False)]
    heads += [(group if one == "autonomy" else f"{group}: {one}", False) for group, one in figures]
    rows: list[list[tuple[str, float | None]]] = []
    for entry in board:
        first = entry[HEADLINE]
        name, training, parameters, seeds = _names(entry)
        cells: list[tuple[str, float | None]] = [
            (name.strip("`"), None),
            (training, None),
            (first["network"], None),
            (parameters, float(first["parameters"])),
            (seeds, float(first["training_seeds"])),
        ]
        for group, one in figures:
            row = entry.get(group)
            share = one in ("autonomy", "without_intervention")
            text = percent(row, one) if share else number(row, one)
            cells.append((text, float(row[one]) if row and row[one] else None))
        rows.append(cells)
    axes = [
        {"key": group, "heading": group, "kind": "figure", "less": False, "share": True}
        for group in (HEADLINE, *GROUPS)
    ]
    scripted = [
        {
            "name": f"{entry[HEADLINE]['entry']} {entry[HEADLINE]['training']}",
            "values": {g: float(row["autonomy"]) for g, row in entry.items() if row["autonomy"]},
            "runs": [],
        }
        for entry in board
    ]
    page = render_page(
        title="drivezoo-bench v1",
        where="docs/benchmark.csv",
        lead="Autonomy by group of roads, with 95 % intervals over roads and training seeds. "
        "Click a heading to sort.",
        heads=heads,
        rows=rows,
        data={"axes": axes, "entries": scripted, "curves": []},
    )
    SORTS.write_text(page)
    return SORTS
