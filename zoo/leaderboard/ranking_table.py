"""The columns of the ranking: what identifies an entry, and its figures as texts and numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from zoo.drives.bootstrap import Estimate, mean_over_seeds
from zoo.drives.drive_record import EMBEDDED
from zoo.drives.metric_registry import LOWER, Metric
from zoo.drives.metrics import leaderboard_metrics
from zoo.evaluate.drives_table import with_deviation
from zoo.leaderboard.ranking import Entry
from zoo.runs.fitted_table import fitted_table
from zoo.runs.table import Cell, Column, interval_figures, two_lines, with_interval

ALWAYS_SHOWN = 2  # figures that long names never push out: autonomy and the number of drives
# Overrides that get no column: paths, and the seed, which has a column of its own.
NO_SETTINGS = ("data.root", "data.images", "data.cache", "seed")


@dataclass(frozen=True)
class Figure:
    """A figure of all entries.

    Attributes:
        entries: rows of the ranking.
        heading: text above the column.
        key: key in `Entry.figures`.
        form: format of the value; empty for counts of drives.
        less: whether a lower value is better.
    """

    entries: Sequence[Entry]
    heading: str
    key: str
    form: str
    less: bool = False

    @property
    def is_autonomy(self) -> bool:
        """Return whether it is an autonomy, which has a length and an interval."""
        return self.key.rpartition("/")[2] == "autonomy"

    @property
    def values(self) -> list[float | None]:
        """Return the means; None where there is none."""
        return [
            found[0] if (found := entry.figures.get(self.key)) else None for entry in self.entries
        ]

    @property
    def texts(self) -> list[str]:
        """Return the texts: an autonomy with its 95 % interval, others with their deviation."""
        return [self._text(entry) for entry in self.entries]

    def _text(self, entry: Entry) -> str:
        value, track = entry.figures.get(self.key), self.key.rpartition("/")[0]
        if value is None:
            return "-"
        if not self.form:
            return "{} of {}".format(*entry.counts[track])
        if not self.is_autonomy:
            return with_deviation(value, self.form)
        text, length = with_interval(self._interval(entry), self.form), entry.short_drive(track)
        return f"{text} of {length}" if length else text

    def _interval(self, entry: Entry) -> Estimate:
        value, deviation = entry.figures.get(self.key) or (math.nan, None)
        return mean_over_seeds(value, deviation, len(entry.runs), (0, 1))

    def column(self, short: bool) -> Column:
        """Return the column for files, with intervals or deviations, or the numbers of drives."""
        name = self.key.replace("/", "_")
        figures: dict[str, Sequence[Cell]]
        if self.form:
            found = [entry.figures.get(self.key) or (None, None) for entry in self.entries]
            means, deviations = zip(*found, strict=True)
            figures = {name: means, f"{name}_std": deviations}
        else:
            track = self.key.rpartition("/")[0]
            counts = [entry.counts.get(track) or (None, None) for entry in self.entries]
            clean, drives = zip(*counts, strict=True)
            figures = {name: drives, f"{name}_without_intervention": clean}
        if self.is_autonomy:
            figures |= interval_figures(name, [self._interval(entry) for entry in self.entries])
        return Column(name, self.heading, self.texts, figures, short)


def ranked_figures(entries: Sequence[Entry]) -> list[Figure]:
    """Return the figures that at least one entry has, the most important first."""
    tracks = list(dict.fromkeys(name for entry in entries for name in entry.first.tracks))
    labels = {track: Path(track).stem if "/" in track else track for track in tracks}
    first, *others = leaderboard_metrics()

    def figure(heading: str, key: str, form: str, less: bool = False) -> Figure:
        return Figure(entries, heading, key, form, less)

    def of_track(metric: Metric, track: str) -> Figure:
        heading, less = metric.column_heading(labels[track]), metric.direction == LOWER
        return figure(heading, f"{track}/{metric.name}", metric.form, less)

    drives = [
        figure(f"drives without intervention, {label}", f"{track}/drives", "")
        for track, label in labels.items()
    ]
    found = [of_track(first, track) for track in tracks]
    overall = [figure(first.label, first.name, first.form)]
    found = [*overall, *drives, *found] if len(tracks) > 1 else [*found, *drives]
    for track, label in labels.items():
        found += [of_track(metric, track) for metric in others]
        laps = figure(f"laps, {label}", f"{track}/laps", "{:.1f}")
        driven = figure(f"driven, {label} (m)", f"{track}/driven_m", "{:,.0f}")
        unknown = [m for m, known in zip(driven.values, laps.values, strict=True) if known is None]
        found += [laps, driven] if any(unknown) else [laps]
    found += [
        figure("val MSE", "val_mse", "{:.4f}", less=True),
        figure("test MSE", "test_mse", "{:.4f}", less=True),
        figure("seconds", "wall_s", "{:,.0f}", less=True),
    ]
    return [one for one in found if set(one.values) != {None}]


def short_figures(figures: Sequence[Figure]) -> set[str]:
    """Return the keys of the figures that a TeX table shows by default.

    They are the autonomy, on one track also the drives and the error; or the errors of the steering
    of runs without drives.
    """
    driven = [one.key for one in figures if one.is_autonomy]
    if len(driven) == 1:
        driven += [one.key for one in figures if one.key.endswith(("/drives", "/cte_mean_m"))]
    return set(driven or ("val_mse", "test_mse"))


def setting_text(value: str | None) -> str:
    """Return a value as typed; long numbers, as a search chooses them, with four digits.

    >>> setting_text("3.3435908606340734e-05"), setting_text("[50,0]"), setting_text(None)
    ('3.344e-05', '[50,0]', '-')
    """
    text = value or "-"
    try:
        return f"{float(text):.4g}" if len(text) > 7 else text
    except ValueError:
        return text


def named_columns(entries: Sequence[Entry], under: Path | None) -> list[Column]:
    """Return the columns that identify entries: rank, folders, model, source, recording."""
    places = list(range(1, len(entries) + 1))
    found = [
        Column("rank", "", list(map(str, places)), {"rank": places}),
        Column("run", "run", [run_name(entry, under) for entry in entries]),
    ]
    names = [entry.first.name for entry in entries]
    settings = {column.name for column in setting_columns(entries)}
    if len(set(names)) > 1 and not {"model", "experiment"} & settings:
        found.append(Column("model", "model", names))
    sources = [entry.first.source or "-" for entry in entries]
    if set(sources) - {"-", EMBEDDED}:
        found.append(Column("drive", "drive", sources))
    recordings = [entry.first.trained_on for entry in entries]
    if len(set(recordings)) > 1:
        found.append(Column("recording", "recording", [one.name for one in recordings]))
    return found


def setting_columns(entries: Sequence[Entry]) -> list[Column]:
    """Return a column for each override whose values differ between entries, in typed order."""
    columns = []
    for key in dict.fromkeys(key for entry in entries for key in entry.first.overrides):
        values = [entry.first.overrides.get(key) for entry in entries]
        if key not in NO_SETTINGS and len(set(values)) > 1:
            columns.append(Column(key, key, list(map(setting_text, values)), {key: values}))
    return columns


def seeds_column(entries: Sequence[Entry]) -> Column:
    """Return the training seeds: `1`, or `1, 2, 3` with `(n = 3)` in a second line."""
    counts = [len(entry.runs) for entry in entries]
    texts = []
    for entry, count in zip(entries, counts, strict=True):
        listed = ", ".join("-" if run.seed is None else str(run.seed) for run in entry.runs)
        texts.append(f"{listed}\n(n = {count})" if count > 1 else listed)
    return Column("training_seeds", "training seeds", texts, {"training_seeds": counts})


def ranking_table(
    entries: Sequence[Entry], title: str, under: Path | None, width: int
) -> tuple[Table, list[str]]:
    """Return the ranking for a terminal: a row for each entry, the best first.

    Args:
        entries: rows of the ranking.
        title: title of the table.
        under: folder to which the runs' folders are shown relative.
        width: columns of the terminal.

    Returns:
        The table, and the headings of the figures that do not fit.
    """
    names, settings = named_columns(entries, under), setting_columns(entries)
    seeds = {run.seed for entry in entries for run in entry.runs}
    last = [seeds_column(entries)] if len(seeds) > 1 else []
    shown = ranked_figures(entries)
    figures = [_narrow_column(one) for one in shown]
    table, left_out = fitted_table(title, [*names, *settings, *last], figures, width, ALWAYS_SHOWN)
    if left_out and len(settings) > 1:
        one_column = _in_one_column(settings)
        identifying = [*names, one_column, *last]
        table, left_out = fitted_table(title, identifying, figures, width, ALWAYS_SHOWN)
    return table, [one.heading for one in shown if one.key in {column.name for column in left_out}]


def _narrow_column(figure: Figure) -> Column:
    """Return a figure's texts with the deviation or the length in a second line."""
    heading = figure.heading.replace(", ", ",\n").replace("without ", "without\n")
    cells = [two_lines(one).replace(" of ", "\nof ", figure.is_autonomy) for one in figure.texts]
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
