"""The ranking as a table for the terminal, and its columns as the HTML page shows them."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from zoo.base.terminal import printable
from zoo.cli.fitted_table import ENOUGH, FRAME, Cells, fits, fitted_table
from zoo.drives.bootstrap import Estimate, mean_over_seeds
from zoo.drives.drive_record import EMBEDDED
from zoo.drives.metric_registry import LOWER, Metric
from zoo.drives.metrics import leaderboard_metrics
from zoo.evaluate.drives_table import with_deviation
from zoo.leaderboard.ranking import Count, Entry, Unranked
from zoo.runs.table_text import two_lines
from zoo.runs.trained_recordings import recording_names

ALWAYS_SHOWN = 2  # figures that long names never push out: autonomy and the number of drives
WIDTH = 140  # of a table that is not printed on a terminal
# Overrides that get no column: paths, and the seed, which has a column of its own.
NO_SETTINGS = ("data.root", "data.images", "data.cache", "seed")


@dataclass(frozen=True)
class Column:
    """A column of figures in the ranking.

    Attributes:
        heading: text above the column.
        key: key in `Entry.figures`.
        form: format of the value; empty for a `Count`.
        less: whether a lower value is better.
    """

    heading: str
    key: str
    form: str
    less: bool = False

    @property
    def has_interval(self) -> bool:
        """Return whether the figure has an interval over training seeds: the autonomy."""
        return self.key.rpartition("/")[2] == "autonomy"


def figure_columns(entries: Sequence[Entry]) -> list[Column]:
    """Return the figures that at least one entry has, the most important first."""
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
        laps = Column(f"laps, {label}", f"{track}/laps", "{:.1f}")
        driven = Column(f"driven, {label} (m)", f"{track}/driven_m", "{:,.0f}")
        unknown = [one for one in entries if not one.figures.get(laps.key)]
        found += [laps, *([driven] if any(one.figures.get(driven.key) for one in unknown) else [])]
    found += [
        Column("val MSE", "val_mse", "{:.4f}", less=True),
        Column("test MSE", "test_mse", "{:.4f}", less=True),
        Column("seconds", "wall_s", "{:,.0f}", less=True),
    ]
    return [one for one in found if any(entry.figures.get(one.key) for entry in entries)]


def _column(metric: Metric, track: str, label: str) -> Column:
    heading = metric.column_heading(label)
    return Column(heading, f"{track}/{metric.name}", metric.form, metric.direction == LOWER)


def short_figures(columns: Sequence[Column]) -> set[str]:
    """Return the keys of the figures that a TeX table shows by default.

    They are the autonomy, on one track also the drives and the error; or the errors of the steering
    of runs without drives.
    """
    driven = [one.key for one in columns if one.has_interval]
    if len(driven) == 1:
        driven += [one.key for one in columns if one.key.endswith(("/drives", "/cte_mean_m"))]
    return set(driven or ("val_mse", "test_mse"))


def figure_text(entry: Entry, column: Column) -> str:
    """Return a figure as text, such as `98.2% ± 0.4%`; a dash where there is none."""
    value = entry.figures.get(column.key)
    if value is None:
        return "-"
    if isinstance(value, Count):
        return f"{value.without_intervention} of {value.drives}"
    return with_deviation(value, column.form) + length_text(entry, column)


def length_text(entry: Entry, column: Column) -> str:
    """Return what stands behind an autonomy over less than a lap, such as ` of 0.1 laps`."""
    length = column.has_interval and entry.short_drive(column.key.rpartition("/")[0] or None)
    return f" of {length}" if length else ""


def interval_of(entry: Entry, column: Column) -> Estimate:
    """Return a share of an entry with its 95 % interval over the training seeds."""
    value, deviation = entry.figures.get(column.key) or (math.nan, None)
    return mean_over_seeds(value, deviation, len(entry.runs), (0, 1))


def value_of(entry: Entry, column: Column) -> float | None:
    """Return a figure as a number to sort by; None where there is none."""
    figure = entry.figures.get(column.key)
    if isinstance(figure, Count):
        return figure.without_intervention / figure.drives
    return figure[0] if figure else None


def setting_columns(entries: Sequence[Entry]) -> list[str]:
    """Return the override keys whose values differ between entries, in typed order."""
    keys = dict.fromkeys(key for entry in entries for key in entry.first.overrides)
    varied = []
    for key in keys:
        values = {entry.first.overrides.get(key) for entry in entries}
        if key not in NO_SETTINGS and len(values) > 1:
            varied.append(key)
    return varied


def has_model_column(entries: Sequence[Entry], settings: Sequence[str]) -> bool:
    """Return whether the runs' names differ and no column of settings shows it."""
    return len({one.first.name for one in entries}) > 1 and not {"model", "experiment"} & set(
        settings
    )


def wide_console() -> Console:
    """Return a console as wide as the terminal; without a terminal, wide enough for tables."""
    console = Console(soft_wrap=True, emoji=False)
    if console.is_terminal or "COLUMNS" in os.environ:
        return console
    return Console(soft_wrap=True, emoji=False, width=WIDTH)


def setting_text(value: str | None) -> str:
    """Return a value as typed; long numbers, as a search chooses them, with four digits.

    >>> setting_text("3.3435908606340734e-05"), setting_text("[50,0]"), setting_text(None)
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
    """Return an entry's training seeds: `1`, or `1, 2, 3` with `(n = 3)` in a second line."""
    listed = ", ".join("-" if run.seed is None else str(run.seed) for run in entry.runs)
    return f"{listed}\n(n = {len(entry.runs)})" if len(entry.runs) > 1 else listed


def named_columns(entries: Sequence[Entry], under: Path | None) -> list[Cells]:
    """Return the columns that identify entries: rank, folders, model, source, recording."""
    found = [
        Cells("", tuple(str(number) for number in range(1, len(entries) + 1)), "right"),
        Cells("run", tuple(run_name(entry, under) for entry in entries)),
    ]
    if has_model_column(entries, setting_columns(entries)):
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
    """Return the ranking as a table with a row for each entry, the best first.

    Args:
        entries: rows of the ranking.
        title: title of the table.
        under: folder to which the runs' folders are shown relative.
        width: columns of the terminal; long names can make the table wider.

    Returns:
        The table, and the headings of the figures that do not fit.
    """
    names = named_columns(entries, under)
    settings = [
        Cells(key, tuple(setting_text(entry.first.overrides.get(key)) for entry in entries))
        for key in setting_columns(entries)
    ]
    seeds = Cells("training seeds", tuple(map(training_seeds, entries)))
    last = [seeds] if len({run.seed for one in entries for run in one.runs}) > 1 else []
    shown = figure_columns(entries)
    figures = [_figure_cells(entries, column, narrow=False) for column in shown]
    identifying = [*names, *settings, *last]
    table, left_out = fitted_table(title, identifying, figures, width)
    if left_out:
        figures = [_figure_cells(entries, column, narrow=True) for column in shown]
        room = width - sum(one.width + FRAME for one in figures[:ALWAYS_SHOWN])
        if len(settings) > 1 and not fits(identifying, ENOUGH, room):
            identifying = [*names, _in_one_column(settings), *last]
        table, left_out = fitted_table(title, identifying, figures, width, ALWAYS_SHOWN)
    pairs = zip(shown, figures, strict=True)
    return table, [column.heading for column, cells in pairs if cells in left_out]


def _figure_cells(entries: Sequence[Entry], column: Column, narrow: bool) -> Cells:
    """Return a figure's cells; narrow ones have the deviation in a second line."""
    cells = [figure_text(entry, column) for entry in entries]
    heading = column.heading.replace(", ", ",\n").replace("without ", "without\n")
    if narrow:
        cells = [two_lines(one).replace(" of ", "\nof ", column.has_interval) for one in cells]
    return Cells(heading, tuple(cells), "right")


def _in_one_column(settings: Sequence[Cells]) -> Cells:
    """Return all settings as one column of `key=value` lines."""
    keys = [column.heading for column in settings]
    cells = []
    for values in zip(*(column.cells for column in settings), strict=True):
        typed = [(key, value) for key, value in zip(keys, values, strict=True) if value != "-"]
        cells.append("\n".join(f"{key}={value}" for key, value in typed))
    return Cells("settings", tuple(cells))


def run_name(entry: Entry, under: Path | None) -> str:
    """Return the folders of an entry's runs, see `folder_label`."""
    return ", ".join(folder_label(run.folder, under) for run in entry.runs)


def folder_label(folder: Path, under: Path | None) -> str:
    """Return `folder` relative to `under` where it is inside, else as it is."""
    if under is not None and folder.resolve().is_relative_to(under.resolve()):
        return str(folder.resolve().relative_to(under.resolve()))
    return str(folder)


def left_out_line(headings: Sequence[str], width: int, page: str) -> str:
    """Return a line that counts and names the columns that do not fit."""
    what = "1 column does" if len(headings) == 1 else f"{len(headings)} columns do"
    named = "; ".join(headings)
    return f"{what} not fit in {width} characters: {named}. Widen the terminal or open {page}"


UNRANKED_TEXTS = {
    "running": "still running",
    "stopped": "stopped before the end",
    "failed": "failed",
    "pruned": "pruned",
    "older": "older or other format",
    "damaged": "damaged",
}
NAMED = 5  # runs that a line names; it counts the others


def unranked_lines(unranked: Sequence[Unranked], under: Path | None) -> list[str]:
    """Return a line for each kind, such as `2 failed: 3 (no space left), 7 (...)`."""
    lines = []
    for why, text in UNRANKED_TEXTS.items():
        found = [one for one in unranked if one.why == why]
        named = [
            folder_label(one.folder, under) + (f" ({one.reason})" if one.reason else "")
            for one in found[:NAMED]
        ]
        if found:
            more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
            lines.append(printable(f"{len(found)} {text}: {', '.join(named)}{more}"))
    return lines
