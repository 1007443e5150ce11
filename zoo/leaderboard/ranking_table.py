"""The ranking as a table: for the terminal, the page and files, and the result that holds it."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from zoo.base.terminal import printable
from zoo.drives.bootstrap import Estimate, mean_over_seeds
from zoo.drives.drive_record import EMBEDDED
from zoo.drives.metric_registry import LOWER, Metric
from zoo.drives.metrics import leaderboard_metrics
from zoo.evaluate.drives_table import with_deviation
from zoo.leaderboard.ranking import Entry
from zoo.leaderboard.scored import Count, Unranked
from zoo.runs.fitted_table import ENOUGH, FRAME, fits, fitted_table, width_of
from zoo.runs.run import recording_names
from zoo.runs.table import Cell, Column, interval_figures, two_lines, with_interval

if TYPE_CHECKING:
    import rich.table

ALWAYS_SHOWN = 2  # figures that long names never push out: autonomy and the number of drives
WIDTH = 140  # of a table that is not printed on a terminal
# Overrides that get no column: paths, and the seed, which has a column of its own.
NO_SETTINGS = ("data.root", "data.images", "data.cache", "seed")


@dataclass(frozen=True)
class Figure:
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


def figure_columns(entries: Sequence[Entry]) -> list[Figure]:
    """Return the figures that at least one entry has, the most important first."""
    tracks = list(dict.fromkeys(name for entry in entries for name in entry.first.tracks))
    labels = {track: Path(track).stem if "/" in track else track for track in tracks}
    first, *others = leaderboard_metrics()
    found = [_column(first, track, label) for track, label in labels.items()]
    drives = [
        Figure(f"drives without intervention, {label}", f"{track}/drives", "")
        for track, label in labels.items()
    ]
    if len(tracks) > 1:
        found = [Figure(first.label, first.name, first.form), *drives, *found]
    else:
        found += drives
    for track, label in labels.items():
        found += [_column(one, track, label) for one in others]
        laps = Figure(f"laps, {label}", f"{track}/laps", "{:.1f}")
        driven = Figure(f"driven, {label} (m)", f"{track}/driven_m", "{:,.0f}")
        unknown = [one for one in entries if not one.figures.get(laps.key)]
        found += [laps, *([driven] if any(one.figures.get(driven.key) for one in unknown) else [])]
    found += [
        Figure("val MSE", "val_mse", "{:.4f}", less=True),
        Figure("test MSE", "test_mse", "{:.4f}", less=True),
        Figure("seconds", "wall_s", "{:,.0f}", less=True),
    ]
    return [one for one in found if any(entry.figures.get(one.key) for entry in entries)]


def _column(metric: Metric, track: str, label: str) -> Figure:
    heading = metric.column_heading(label)
    return Figure(heading, f"{track}/{metric.name}", metric.form, metric.direction == LOWER)


def short_figures(columns: Sequence[Figure]) -> set[str]:
    """Return the keys of the figures that a TeX table shows by default.

    They are the autonomy, on one track also the drives and the error; or the errors of the steering
    of runs without drives.
    """
    driven = [one.key for one in columns if one.has_interval]
    if len(driven) == 1:
        driven += [one.key for one in columns if one.key.endswith(("/drives", "/cte_mean_m"))]
    return set(driven or ("val_mse", "test_mse"))


def figure_text(entry: Entry, column: Figure) -> str:
    """Return a figure as text, such as `98.2% ± 0.4%`; a dash where there is none."""
    value = entry.figures.get(column.key)
    if value is None:
        return "-"
    if isinstance(value, Count):
        return f"{value.without_intervention} of {value.drives}"
    return with_deviation(value, column.form) + length_text(entry, column)


def length_text(entry: Entry, column: Figure) -> str:
    """Return what stands behind an autonomy over less than a lap, such as ` of 0.1 laps`."""
    length = column.has_interval and entry.short_drive(column.key.rpartition("/")[0] or None)
    return f" of {length}" if length else ""


def interval_of(entry: Entry, column: Figure) -> Estimate:
    """Return a share of an entry with its 95 % interval over the training seeds."""
    value, deviation = entry.figures.get(column.key) or (math.nan, None)
    return mean_over_seeds(value, deviation, len(entry.runs), (0, 1))


def value_of(entry: Entry, column: Figure) -> float | None:
    """Return a figure as a number to sort by; None where there is none."""
    figure = entry.figures.get(column.key)
    if isinstance(figure, Count):
        return figure.without_intervention / figure.drives
    return figure[0] if figure else None


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


def named_columns(entries: Sequence[Entry], under: Path | None) -> list[Column]:
    """Return the columns that identify entries: rank, folders, model, source, recording."""
    places = list(range(1, len(entries) + 1))
    found = [
        Column("rank", "", list(map(str, places)), {"rank": places}),
        Column("run", "run", [run_name(entry, under) for entry in entries]),
    ]
    names = [entry.first.name for entry in entries]
    if len(set(names)) > 1 and not {"model", "experiment"} & set(setting_keys(entries)):
        found.append(Column("model", "model", names))
    sources = [entry.first.source or "-" for entry in entries]
    if set(sources) - {"-", EMBEDDED}:
        found.append(Column("drive", "drive", sources))
    recordings = [entry.first.trained_on for entry in entries]
    if len(set(recordings)) > 1:
        labels = recording_names(recordings)
        found.append(Column("recording", "recording", [labels[one] for one in recordings]))
    return found


def setting_columns(entries: Sequence[Entry]) -> list[Column]:
    """Return a column for each override whose values differ between entries, in typed order."""
    columns = []
    for key in setting_keys(entries):
        values = [entry.first.overrides.get(key) for entry in entries]
        columns.append(Column(key, key, list(map(setting_text, values)), {key: values}))
    return columns


def setting_keys(entries: Sequence[Entry]) -> list[str]:
    """Return the override keys whose values differ between entries, in typed order."""
    keys = dict.fromkeys(key for entry in entries for key in entry.first.overrides)
    values = {key: {entry.first.overrides.get(key) for entry in entries} for key in keys}
    return [key for key in keys if key not in NO_SETTINGS and len(values[key]) > 1]


def seeds_column(entries: Sequence[Entry]) -> Column:
    """Return the training seeds: `1`, or `1, 2, 3` with `(n = 3)` in a second line."""
    counts = [len(entry.runs) for entry in entries]
    texts = []
    for entry, count in zip(entries, counts, strict=True):
        listed = ", ".join("-" if run.seed is None else str(run.seed) for run in entry.runs)
        texts.append(f"{listed}\n(n = {count})" if count > 1 else listed)
    return Column("training_seeds", "training seeds", texts, {"training_seeds": counts})


def figure_column(entries: Sequence[Entry], figure: Figure, short: bool) -> Column:
    """Return a column with intervals or deviations, or the numbers of drives."""
    name = figure.key.replace("/", "_")
    found = [entry.figures.get(figure.key) for entry in entries]
    texts = [figure_text(entry, figure) for entry in entries]
    figures: dict[str, Sequence[Cell]]
    if any(isinstance(one, Count) for one in found):
        counts = [one if isinstance(one, Count) else None for one in found]
        figures = {
            name: [one and one.drives for one in counts],
            f"{name}_without_intervention": [one and one.without_intervention for one in counts],
        }
    else:
        means, deviations = zip(*(one or (None, None) for one in found), strict=True)
        figures = {name: means, f"{name}_std": deviations}
        if figure.has_interval:
            intervals = [interval_of(entry, figure) for entry in entries]
            figures |= interval_figures(name, intervals)
            texts = [
                with_interval(one, figure.form) + length_text(entry, figure)
                for entry, one in zip(entries, intervals, strict=True)
            ]
    return Column(name, figure.heading, texts, figures, short)


def ranking_table(
    entries: Sequence[Entry], title: str, under: Path | None = None, width: int = WIDTH
) -> tuple["rich.table.Table", list[str]]:
    """Return the ranking for a terminal: a row for each entry, the best first.

    Args:
        entries: rows of the ranking.
        title: title of the table.
        under: folder to which the runs' folders are shown relative.
        width: columns of the terminal; long names can make the table wider.

    Returns:
        The table, and the headings of the figures that do not fit.
    """
    names, settings = named_columns(entries, under), setting_columns(entries)
    seeds = {run.seed for entry in entries for run in entry.runs}
    last = [seeds_column(entries)] if len(seeds) > 1 else []
    shown = figure_columns(entries)
    figures = [_terminal_column(entries, one, narrow=False) for one in shown]
    identifying = [*names, *settings, *last]
    table, left_out = fitted_table(title, identifying, figures, width)
    if left_out:
        figures = [_terminal_column(entries, one, narrow=True) for one in shown]
        room = width - sum(width_of(one) + FRAME for one in figures[:ALWAYS_SHOWN])
        if len(settings) > 1 and not fits(identifying, ENOUGH, room):
            identifying = [*names, _in_one_column(settings), *last]
        table, left_out = fitted_table(title, identifying, figures, width, ALWAYS_SHOWN)
    pairs = zip(shown, figures, strict=True)
    return table, [figure.heading for figure, column in pairs if column in left_out]


def _terminal_column(entries: Sequence[Entry], figure: Figure, narrow: bool) -> Column:
    """Return a figure's texts; narrow ones have the deviation in a second line."""
    cells = [figure_text(entry, figure) for entry in entries]
    heading = figure.heading.replace(", ", ",\n").replace("without ", "without\n")
    if narrow:
        cells = [two_lines(one).replace(" of ", "\nof ", figure.has_interval) for one in cells]
    return Column(figure.key, heading, cells)


def _in_one_column(settings: Sequence[Column]) -> Column:
    """Return all settings as one column of `key=value` lines."""
    cells = []
    for values in zip(*(column.cells for column in settings), strict=True):
        typed = zip((column.name for column in settings), values, strict=True)
        cells.append("\n".join(f"{key}={value}" for key, value in typed if value != "-"))
    return Column("settings", "settings", cells)


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
