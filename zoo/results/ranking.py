"""Group what is ranked by training seed, sort it, the best driver first, and show its columns.

Sweeps and the leaderboard use it. Runs without a drive rank below all runs with one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from zoo.driving.drive_record import EMBEDDED
from zoo.driving.drives_table import mean_and_deviation, with_deviation
from zoo.driving.intervals import Estimate, mean_over_seeds
from zoo.driving.metrics import LOWER, Metric, leaderboard_metrics
from zoo.results.result import SCORES
from zoo.results.scored import Scored
from zoo.runs.record_fields import Spread
from zoo.runs.result_table import (
    Cell,
    Column,
    fitted_table,
    interval_figures,
    number_column,
    two_lines,
    with_interval,
)

LAST = float("inf")  # sorts after every figure
WHOLE_LAP = 0.95  # laps; a drive that ends a little before its start counts as a lap
LAP_M = 1000.0  # where the laps are unknown; the included circuits are longer
ALWAYS_SHOWN = 2  # figures that long names never push out: autonomy and the number of drives
# Overrides that get no column: paths, what learns nothing, and the seed, which has its own.
NO_SETTINGS = ("data.root", "data.images", "data.cache", "logger", "seed")


@dataclass(frozen=True)
class Entry:
    """A row of the ranking: a run, or several that differ only in their training seed.

    Attributes:
        figures: by `autonomy`, `cte_m`, `val_mse`, ..., and by `TRACK/autonomy`, ..., mean and
            sample deviation over the training seeds; by `TRACK/drives`, share of the drives without
            an intervention. None where a run lacks the figure.
        counts: by track, number of drives without an intervention and of drives.
    """

    runs: tuple[Scored, ...]
    figures: dict[str, Spread | None]
    counts: dict[str, tuple[int, int]]

    @property
    def score(self) -> Spread | None:
        """Return the figure that ranks the entry, one of `SCORES`, over its tracks."""
        return next(filter(None, (self.figures[key] for key in SCORES)), None)

    @property
    def first(self) -> Scored:
        """Return the run with the lowest training seed."""
        return self.runs[0]

    def short_drive(self, track: str = "") -> str:
        """Return the length of the shortest drives of less than a lap, such as `0.1 laps`.

        Args:
            track: track of the drives; empty for any.

        Returns:
            The length; empty if all drives are as long as a lap, or their length is unknown.
        """
        tracks = [pair for run in self.runs for pair in run.tracks.items()]
        driven = [figures for name, figures in tracks if track in ("", name)]
        laps = min((row["laps"] for row in driven if "laps" in row), default=LAST)
        if laps < WHOLE_LAP:
            return f"{laps:.2g} laps"
        lengths = (row.get("driven_m", LAST) for row in driven if "laps" not in row)
        metres = min(lengths, default=LAST)
        return f"{metres:.0f} m" if metres < LAP_M else ""


def rank(runs: Sequence[Scored]) -> list[Entry]:
    """Sort runs by `Entry.score`, then cross-track error, then validation MSE.

    Drives of less than a lap come after all that are longer: most roads are easy at their start.
    Repeats with other training seeds form one entry. Where runs were driven on different tracks,
    only the tracks that all of them share count.
    """
    groups: dict[str, list[Scored]] = {}
    for run in runs:
        groups.setdefault(run.settings or str(run.folder.resolve()), []).append(run)
    driven = [run.tracks for run in runs if run.tracks]
    shared = set(driven[0]).intersection(*driven) if driven else set()
    return sorted((_entry(group, shared) for group in groups.values()), key=_order)


def _entry(runs: Sequence[Scored], shared: set[str]) -> Entry:
    runs = sorted(runs, key=lambda run: (run.seed is None, run.seed))
    keys = ("val_mse", "test_mse", "wall_s")
    figures = {key: _spread([getattr(run, key) for run in runs], runs) for key in keys}
    figures |= {key: _spread([run.mean(key, shared) for run in runs], runs) for key in SCORES}
    figures["cte_m"] = _spread([run.mean("cte_mean_m", shared) for run in runs], runs)
    counts = {}
    for track in dict.fromkeys(name for run in runs for name in run.tracks):
        by_run = [run.tracks.get(track, {}) for run in runs]
        for key in dict.fromkeys(key for drive in by_run for key in drive):
            figures[f"{track}/{key}"] = _spread([drive.get(key) for drive in by_run], runs)
        if all(track in run.counts for run in runs):
            clean, drives = np.sum([run.counts[track] for run in runs], axis=0).tolist()
            counts[track] = clean, drives
            figures[f"{track}/drives"] = (clean / drives, None) if drives else None
    return Entry(tuple(runs), figures, counts)


def _spread(values: Sequence[float | None], runs: Sequence[Scored]) -> Spread | None:
    """Return mean and deviation over training seeds; runs of one seed count as one, by their mean.

    None where a run has no value.
    """
    by_seed: dict[int | None, list[float]] = {}
    for value, run in zip(values, runs, strict=True):
        if value is None:
            return None
        by_seed.setdefault(run.seed, []).append(value)
    return mean_and_deviation([sum(same) / len(same) for same in by_seed.values()])


def _order(entry: Entry) -> tuple:
    score, cte, mse = entry.score, entry.figures["cte_m"], entry.figures["val_mse"]
    return (
        score is None,
        bool(entry.short_drive()),
        -score[0] if score else LAST,
        cte[0] if cte else LAST,
        mse[0] if mse else LAST,
        str(entry.first.folder),
    )


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
    def is_score(self) -> bool:
        """Return whether it is one of `SCORES`, which have a length and an interval."""
        return self.key.rpartition("/")[2] in SCORES

    @property
    def values(self) -> list[float | None]:
        """Return the means; None where there is none."""
        return [(entry.figures.get(self.key) or (None, None))[0] for entry in self.entries]

    @property
    def texts(self) -> list[str]:
        """Return the texts: a score with its 95 % interval, others with their deviation."""
        return [self._text(entry) for entry in self.entries]

    def _text(self, entry: Entry) -> str:
        value, track = entry.figures.get(self.key), self.key.rpartition("/")[0]
        if value is None:
            return "-"
        if not self.form:
            return "{} of {}".format(*entry.counts[track])
        if not self.is_score:
            return with_deviation(value, self.form)
        text, length = with_interval(self.interval(entry), self.form), entry.short_drive(track)
        return f"{text} of {length}" if length else text

    def interval(self, entry: Entry) -> Estimate:
        """Return an entry's mean with its 95 % interval over training seeds, each counted once."""
        value, deviation = entry.figures.get(self.key) or (math.nan, None)
        seeds, greatest = {run.seed for run in entry.runs}, 1 if self.is_score else math.inf
        return mean_over_seeds(value, deviation, len(seeds), (0, greatest))

    def column(self, short: bool) -> Column:
        """Return the column for files, with intervals or deviations, or the numbers of drives."""
        name = self.key.replace("/", "_")
        figures: dict[str, Sequence[Cell]]
        if self.form:
            pairs = [entry.figures.get(self.key) or (None, None) for entry in self.entries]
            figures = {name: [mean for mean, _ in pairs], f"{name}_std": [std for _, std in pairs]}
        else:
            track = self.key.rpartition("/")[0]
            counts = [entry.counts.get(track) or (None, None) for entry in self.entries]
            figures = {
                name: [drives for _, drives in counts],
                f"{name}_without_intervention": [without for without, _ in counts],
            }
        if self.is_score:
            figures |= interval_figures(name, [self.interval(entry) for entry in self.entries])
        return Column(name, self.heading, self.texts, figures, short)


def ranked_figures(entries: Sequence[Entry]) -> list[Figure]:
    """Return the figures that at least one entry has, the most important first."""
    tracks = list(dict.fromkeys(name for entry in entries for name in entry.first.tracks))
    labels = {track: Path(track).stem if Path(track).name != track else track for track in tracks}
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
    figures = [
        figure(f"{label}, {labels[track]}", f"{track}/{key}", first.form)
        for track in tracks
        for key, label in SCORES.items()
    ]
    overall = [figure(label, key, first.form) for key, label in SCORES.items()]
    figures = [*overall, *drives, *figures] if len(tracks) > 1 else [*figures, *drives]
    for track, label in labels.items():
        figures += [of_track(metric, track) for metric in others]
        laps = figure(f"laps, {label}", f"{track}/laps", "{:.1f}")
        driven = figure(f"driven, {label} (m)", f"{track}/driven_m", "{:,.0f}")
        unknown = [m for m, count in zip(driven.values, laps.values, strict=True) if count is None]
        figures += [laps, driven] if any(unknown) else [laps]
    figures += [
        figure("val MSE", "val_mse", "{:.4f}", less=True),
        figure("test MSE", "test_mse", "{:.4f}", less=True),
        figure("seconds", "wall_s", "{:,.0f}", less=True),
    ]
    return [column for column in figures if set(column.values) != {None}]


def short_figures(figures: Sequence[Figure]) -> set[str]:
    """Return the keys of the figures that a TeX table shows by default.

    They are the scores, on one track also the drives and the error; or the errors of the steering
    of runs without drives.
    """
    driven = [figure.key for figure in figures if figure.is_score]
    if len(driven) == 1:
        driven += [
            figure.key for figure in figures if figure.key.endswith(("/drives", "/cte_mean_m"))
        ]
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
    named = [
        number_column("rank", "", list(range(1, len(entries) + 1))),
        Column("run", "run", [run_name(entry, under) for entry in entries]),
    ]
    names = [entry.first.name for entry in entries]
    settings = {column.name for column in setting_columns(entries)}
    if len(set(names)) > 1 and not {"model", "experiment"} & settings:
        named.append(Column("model", "model", names))
    sources = [entry.first.source or "-" for entry in entries]
    if set(sources) - {"-", EMBEDDED}:
        named.append(Column("drive", "drive", sources))
    recordings = [entry.first.trained_on for entry in entries]
    if len(set(recordings)) > 1:
        named.append(Column("recording", "recording", [recording.name for recording in recordings]))
    return named


def setting_columns(entries: Sequence[Entry]) -> list[Column]:
    """Return a column for each override whose values differ between entries, in typed order."""
    columns = []
    # The runs of an entry have one config, whichever of them typed a key.
    for key in dict.fromkeys(k for entry in entries for run in entry.runs for k in run.overrides):
        typed = ([run.overrides.get(key) for run in entry.runs] for entry in entries)
        values = [next(filter(None, texts), None) for texts in typed]
        if key not in NO_SETTINGS and len(set(values)) > 1:
            columns.append(Column(key, key, list(map(setting_text, values)), {key: values}))
    return columns


def seeds_column(entries: Sequence[Entry]) -> Column:
    """Return the training seeds: `1`, or `1, 2, 3` with `(n = 3)` in a second line.

    The second line names the precisions and the codes where they differ.
    """
    counts = [row.first.trainings * len({run.seed for run in row.runs}) for row in entries]
    texts = []
    for entry, count in zip(entries, counts, strict=True):
        listed = ", ".join("-" if run.seed is None else str(run.seed) for run in entry.runs)
        mixed = ""
        for key in ("precision", "code"):
            values = sorted({getattr(run, key) for run in entry.runs} - {""})
            mixed += f", {key} {' and '.join(values)}" if len(values) > 1 else ""
        texts.append(f"{listed}\n(n = {count}{mixed})" if count > 1 else listed)
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
    figures = [_narrow_column(figure) for figure in shown]
    table, left_out = fitted_table(title, [*names, *settings, *last], figures, width, ALWAYS_SHOWN)
    if left_out and len(settings) > 1:
        identifying = [*names, in_one_column(settings), *last]
        table, left_out = fitted_table(title, identifying, figures, width, ALWAYS_SHOWN)
    missing = {column.name for column in left_out}
    return table, [figure.heading for figure in shown if figure.key in missing]


def _narrow_column(figure: Figure) -> Column:
    """Return a figure's texts with the deviation or the length in a second line."""
    heading = figure.heading.replace(", ", ",\n").replace("without ", "without\n")
    cells = [two_lines(text).replace(" of ", "\nof ", figure.is_score) for text in figure.texts]
    return Column(figure.key, heading, cells)


def in_one_column(settings: Sequence[Column]) -> Column:
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
    if under is not None and under.resolve() in folder.resolve().parents:
        return str(folder.resolve().relative_to(under.resolve()))
    return str(folder)
