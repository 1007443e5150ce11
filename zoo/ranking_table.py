"""The ranking as a table for the terminal, and as rows for a page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from zoo.ranking import Entry, Unranked, protocols, rank, read_runs

# Where things are is no setting; how long it may take is.
PLACES = ("data.root", "data.images", "data.cache", "seed")


@dataclass(frozen=True)
class Column:
    """A figure of the ranking: its heading, where it stands in `Entry.figures`, how it is said."""

    heading: str
    key: str
    form: str


def columns(entries: Sequence[Entry]) -> list[Column]:
    """Of all that some entry has, in the order of the ranking."""
    tracks = list(dict.fromkeys(name for entry in entries for name in entry.first.tracks))
    found = []
    if len(tracks) > 1:
        found.append(Column("autonomy", "autonomy", "{:.1%}"))
    for track in tracks:
        name = Path(track).stem if "/" in track else track
        found.append(Column(f"autonomy, {name}", f"{track}/autonomy", "{:.1%}"))
    for track in tracks:
        name = Path(track).stem if "/" in track else track
        found.append(Column(f"error, {name} (m)", f"{track}/cte_mean_m", "{:.2f}"))
        found.append(Column(f"interventions, {name}", f"{track}/interventions", "{:.1f}"))
    found += [
        Column("val MSE", "val_mse", "{:.4f}"),
        Column("test MSE", "test_mse", "{:.4f}"),
        Column("seconds", "wall_s", "{:,.0f}"),
    ]
    return [one for one in found if any(entry.figures.get(one.key) for entry in entries)]


def said(figures: dict, column: Column) -> str:
    """`98.2% ± 0.4%`; a dash where there is none, and no spread of a single run."""
    value = figures.get(column.key)
    if value is None:
        return "-"
    mean, spread = (column.form.format(one) for one in value)
    return f"{mean} ± {spread}" if value[1] else mean


def setting_columns(entries: Sequence[Entry]) -> list[str]:
    """The overrides in which the entries differ, in the order in which they were typed."""
    keys = dict.fromkeys(key for entry in entries for key in entry.first.overrides)
    varied = []
    for key in keys:
        values = {entry.first.overrides.get(key) for entry in entries}
        if key not in PLACES and len(values) > 1:
            varied.append(key)
    return varied


def is_named(entries: Sequence[Entry], settings: Sequence[str]) -> bool:
    """Whether the names of the runs say what no column of settings says."""
    return len({one.first.name for one in entries}) > 1 and not {"model", "experiment"} & set(
        settings
    )


def wide_console() -> Console:
    """As wide as the terminal; where nobody watches, wide enough for most tables."""
    console = Console(soft_wrap=True)
    return console if console.is_terminal else Console(soft_wrap=True, width=140)


def shown_setting(value: str | None) -> str:
    """A value as typed; a number of a search, which has sixteen digits, with four.

    >>> shown_setting("3.3435908606340734e-05"), shown_setting("[50,0]"), shown_setting(None)
    ('3.344e-05', '[50,0]', '-')
    """
    if value is None:
        return "-"
    try:
        number = float(value)
    except ValueError:
        return value
    return f"{number:.4g}" if len(value) > 7 else value


def seeds(entry: Entry) -> str:
    """`1`, or `1, 2, 3`: of the runs of an entry."""
    return ", ".join(str(run.seed) for run in entry.runs)


def ranking_table(entries: Sequence[Entry], title: str, under: Path | None = None) -> Table:
    """A line an entry, the best first; folders are said below `under`."""
    table = Table(title=title, title_justify="left")
    figures, settings = columns(entries), setting_columns(entries)
    many = any(len(entry.runs) > 1 for entry in entries)
    table.add_column("", justify="right")
    table.add_column("run", overflow="fold")
    names = is_named(entries, settings)
    for heading in [*(["model"] if names else []), *settings, *(["seeds"] if many else [])]:
        table.add_column(heading, overflow="fold")
    for column in figures:
        heading = column.heading.replace(", ", ",\n")  # room for the settings' own
        table.add_column(heading, justify="right", no_wrap=True)
    for place, entry in enumerate(entries, 1):
        cells = [str(place), run_name(entry, under)]
        cells += [entry.first.name] if names else []
        cells += [shown_setting(entry.first.overrides.get(key)) for key in settings]
        cells += [seeds(entry)] if many else []
        cells += [said(entry.figures, column) for column in figures]
        table.add_row(*cells, style="bold" if place == 1 else None)
    return table


def run_name(entry: Entry, under: Path | None) -> str:
    """The folders of its runs, below `under` where they are."""
    return ", ".join(below(run.folder, under) for run in entry.runs)


def below(folder: Path, under: Path | None) -> str:
    """`folder` as seen from `under`, where it is in there."""
    if under is not None and folder.resolve().is_relative_to(under.resolve()):
        return str(folder.resolve().relative_to(under.resolve()))
    return str(folder)


def print_ranking(
    folders: Sequence[Path], title: str, under: Path, console: Console
) -> tuple[list[Entry], list[Unranked]]:
    """Read, rank, print; what can't be ranked is counted and named in a line each kind."""
    runs, unranked = read_runs(folders)
    entries = rank(runs)
    if entries:
        console.print(ranking_table(entries, title, under))
    different = protocols(runs)
    if different:
        console.print(
            f"not all were driven alike, compare with care: {'; '.join(different)}",
            highlight=False,
            markup=False,
        )
    for line in unranked_lines(unranked, under):
        console.print(line, highlight=False, markup=False)
    return entries, unranked


WORDS = {
    "running": "still running",
    "stopped": "stopped half way",
    "failed": "failed",
    "pruned": "pruned",
    "older": "older or other format",
}
NAMED = 5


def unranked_lines(unranked: Sequence[Unranked], under: Path | None) -> list[str]:
    """`2 failed: 3 (no space left), 7 (...)`, a line for each kind."""
    lines = []
    for why, words in WORDS.items():
        those = [one for one in unranked if one.why == why]
        named = [
            below(one.folder, under) + (f" ({one.reason})" if one.reason else "")
            for one in those[:NAMED]
        ]
        if those:
            more = f" and {len(those) - NAMED} more" if len(those) > NAMED else ""
            lines.append(f"{len(those)} {words}: {', '.join(named)}{more}")
    return lines
