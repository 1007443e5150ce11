"""The ranking as a table for the terminal, and as rows for a page."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from datamodules.terminal import printable
from zoo.cli.fitted_table import ENOUGH, FRAME, Cells, fits, fitted_table
from zoo.drives.drive_record import EMBEDDED
from zoo.drives.intervals import count_with_interval
from zoo.drives.metric_registry import LOWER, Metric
from zoo.drives.metrics import leaderboard_metrics
from zoo.evaluate.drives_table import two_lines, with_deviation
from zoo.leaderboard.ranked_drive import read_drives
from zoo.leaderboard.ranking import Count, Entry, Unranked, protocols, rank, read_runs
from zoo.runs.trained_recordings import recording_names

SURELY = 2  # figures that long names do not push out: autonomy, and of how many drives
WIDTH = 140  # of a table that no terminal limits
# Where things are is no setting; how long it may take is.
PLACES = ("data.root", "data.images", "data.cache", "seed")


@dataclass(frozen=True)
class Column:
    """A figure of the ranking.

    Attributes:
        heading: its words.
        key: place in `Entry.figures`.
        form: format of its value.
        less: less of it is better.
    """

    heading: str
    key: str
    form: str
    less: bool = False


def columns(entries: Sequence[Entry]) -> list[Column]:
    """Of all that some entry has, the most important first."""
    tracks = list(dict.fromkeys(name for entry in entries for name in entry.first.tracks))
    labels = {track: Path(track).stem if "/" in track else track for track in tracks}
    first, *others = leaderboard_metrics()
    found = [_column(first, track, label) for track, label in labels.items()]
    drives = [
        Column(f"drives without intervention, {label}", f"{track}/drives", "")
        for track, label in labels.items()
    ]
    if len(tracks) > 1:
        found = [Column(first.label, first.name, first.form), *drives, *found]
    else:
        found += drives
    for track, label in labels.items():
        found += [_column(one, track, label) for one in others]
    found += [
        Column("val MSE", "val_mse", "{:.4f}", less=True),
        Column("test MSE", "test_mse", "{:.4f}", less=True),
        Column("seconds", "wall_s", "{:,.0f}", less=True),
    ]
    return [one for one in found if any(entry.figures.get(one.key) for entry in entries)]


def _column(metric: Metric, track: str, label: str) -> Column:
    heading = metric.column_heading(label)
    return Column(heading, f"{track}/{metric.name}", metric.form, metric.direction == LOWER)


def said(figures: dict, column: Column) -> str:
    """`98.2% ± 0.4%`; a dash where there is none, and no spread of a single training."""
    value = figures.get(column.key)
    if value is None:
        return "-"
    if isinstance(value, Count):
        return count_with_interval(value.kept, value.drives)
    return with_deviation(value, column.form)


def value_of(entry: Entry, column: Column) -> float | None:
    """Return a figure as a number to sort by; None where there is none."""
    figure = entry.figures.get(column.key)
    if isinstance(figure, Count):
        return figure.kept / figure.drives
    return figure[0] if figure else None


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
    console = Console(soft_wrap=True, emoji=False)
    if console.is_terminal or "COLUMNS" in os.environ:
        return console
    return Console(soft_wrap=True, emoji=False, width=WIDTH)


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


def training_seeds(entry: Entry) -> str:
    """Return `1`, or `1, 2, 3` and in a second line `(n = 3)`: of the runs of an entry."""
    listed = ", ".join("-" if run.seed is None else str(run.seed) for run in entry.runs)
    return f"{listed}\n(n = {len(entry.runs)})" if len(entry.runs) > 1 else listed


def named_columns(entries: Sequence[Entry], under: Path | None) -> list[Cells]:
    """What tells the entries apart, settings apart: place, folders, model and recording."""
    found = [
        Cells("", tuple(str(place) for place in range(1, len(entries) + 1)), "right"),
        Cells("run", tuple(run_name(entry, under) for entry in entries)),
    ]
    if is_named(entries, setting_columns(entries)):
        found.append(Cells("model", tuple(entry.first.name for entry in entries)))
    sources = tuple(entry.first.source or "-" for entry in entries)
    if set(sources) - {"-", EMBEDDED}:
        found.append(Cells("drive", sources))
    recordings = [entry.first.trained_on for entry in entries]
    if len(set(recordings)) > 1:
        names = recording_names(recordings)
        found.append(Cells("recording", tuple(names[one] for one in recordings)))
    return found


def ranking_table(
    entries: Sequence[Entry], title: str, under: Path | None = None, width: int = WIDTH
) -> tuple[Table, list[str]]:
    """A line an entry, the best first; folders are said below `under`.

    Returns:
        The table, at most `width` wide where the names leave room for that, and the headings of
        the figures that do not fit.
    """
    names = named_columns(entries, under)
    settings = [
        Cells(key, tuple(shown_setting(entry.first.overrides.get(key)) for entry in entries))
        for key in setting_columns(entries)
    ]
    seeds = Cells("training seeds", tuple(map(training_seeds, entries)))
    last = [seeds] if len({run.seed for one in entries for run in one.runs}) > 1 else []
    shown = columns(entries)
    figures = [_figure_cells(entries, column, narrow=False) for column in shown]
    identifying = [*names, *settings, *last]
    table, left_out = fitted_table(title, identifying, figures, width)
    if left_out:
        figures = [_figure_cells(entries, column, narrow=True) for column in shown]
        room = width - sum(one.width + FRAME for one in figures[:SURELY])
        if len(settings) > 1 and not fits(identifying, ENOUGH, room):
            identifying = [*names, _in_one_column(settings), *last]
        table, left_out = fitted_table(title, identifying, figures, width, SURELY)
    pairs = zip(shown, figures, strict=True)
    return table, [column.heading for column, cells in pairs if cells in left_out]


def _figure_cells(entries: Sequence[Entry], column: Column, narrow: bool) -> Cells:
    """Return a figure's column; a narrow one has deviation and interval in a second line."""
    cells = [said(entry.figures, column) for entry in entries]
    heading = column.heading.replace(", ", ",\n").replace("without ", "without\n")
    if narrow:
        cells = [two_lines(one).replace(" ±", "\n±") for one in cells]
    return Cells(heading, tuple(cells), "right")


def _in_one_column(settings: Sequence[Cells]) -> Cells:
    """Where there are too many for a column each."""
    keys = [column.heading for column in settings]
    cells = []
    for values in zip(*(column.cells for column in settings), strict=True):
        typed = [(key, value) for key, value in zip(keys, values, strict=True) if value != "-"]
        cells.append("\n".join(f"{key}={value}" for key, value in typed))
    return Cells("settings", tuple(cells))


def run_name(entry: Entry, under: Path | None) -> str:
    """The folders of its runs, below `under` where they are."""
    return ", ".join(below(run.folder, under) for run in entry.runs)


def below(folder: Path, under: Path | None) -> str:
    """`folder` as seen from `under`, where it is in there."""
    if under is not None and folder.resolve().is_relative_to(under.resolve()):
        return str(folder.resolve().relative_to(under.resolve()))
    return str(folder)


def print_ranking(
    folders: Sequence[Path],
    title: str,
    under: Path,
    console: Console,
    page: str,
    drives: Sequence[Path] = (),
) -> tuple[list[Entry], list[Unranked]]:
    """Read, rank, print; what can't be ranked is counted and named in a line each kind.

    Args:
        folders: of the runs.
        title: of the table.
        under: folders are said below it.
        console: for the table and the lines below it.
        page: where all columns are found.
        drives: folders of drives, to be ranked beside the runs.
    """
    runs, unranked = read_runs(folders)
    driven, unread = read_drives(drives)
    runs, unranked = [*runs, *driven], [*unranked, *unread]
    entries = rank(runs)
    if entries:
        table, left_out = ranking_table(entries, title, under, console.width)
        console.print(table)
        if left_out:
            line = left_out_line(left_out, console.width, page)
            console.print(line, highlight=False, markup=False, soft_wrap=True)
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


def left_out_line(headings: Sequence[str], width: int, page: str) -> str:
    """Return a line that counts and names the columns that a table has no room for."""
    what = "1 column does" if len(headings) == 1 else f"{len(headings)} columns do"
    named = "; ".join(headings)
    return f"{what} not fit in {width}: {named}. Widen the terminal or open {page}"


WORDS = {
    "running": "still running",
    "stopped": "stopped half way",
    "failed": "failed",
    "pruned": "pruned",
    "older": "older or other format",
    "damaged": "damaged",
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
            lines.append(printable(f"{len(those)} {words}: {', '.join(named)}{more}"))
    return lines
