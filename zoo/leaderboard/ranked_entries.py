"""The result of `drivezoo leaderboard`: its table, and how it is printed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from zoo.drives.drive_record import EMBEDDED
from zoo.leaderboard.ranked_drive import read_drives
from zoo.leaderboard.ranking import BENCHMARK, Count, Entry, Unranked, protocols, rank, read_runs
from zoo.leaderboard.ranking_table import (
    Column,
    figure_columns,
    figure_text,
    interval_of,
    left_out_line,
    length_text,
    named_columns,
    ranking_table,
    run_name,
    setting_columns,
    setting_text,
    short_figures,
    training_seeds,
    unranked_lines,
)
from zoo.runs.result_table import Cell, Result, ResultTable, TableColumn
from zoo.runs.table_text import interval_figures, with_interval

CAPTION = (
    "Ranking by autonomy. In brackets: 95 % interval over training seeds (Student's t); ±: sample "
    "standard deviation over training seeds."
)
FEW = 3  # settings that stand for the run's folder in a TeX table


@dataclass(frozen=True, repr=False)
class Ranking(Result):
    """Ranked runs and drives.

    Attributes:
        entries: rows of the ranking, the best first.
        unranked: runs without figures.
        different: how the runs were driven, where it is not the same for all.
        under: folder to which the runs' folders are shown relative.
    """

    entries: list[Entry]
    unranked: list[Unranked]
    different: list[str]
    under: Path

    @classmethod
    def read(cls, folders: Sequence[Path], under: Path, drives: Sequence[Path] = ()) -> "Ranking":
        """Rank the runs of some folders, and drives together with them."""
        runs, unranked = read_runs(folders)
        driven, unread = read_drives(drives)
        runs = [*runs, *driven]
        return cls(rank(runs), [*unranked, *unread], protocols(runs), under)

    def __repr__(self) -> str:
        best = f"; the best: {run_name(self.entries[0], self.under)}" if self.entries else ""
        return f"Ranking of {len(self.entries)} entries{best}"

    def result_table(self) -> ResultTable:
        """Return a row for each entry, the best first."""
        entries, runs = self.entries, [one.first for one in self.entries]
        settings, shown = setting_columns(entries), figure_columns(entries)
        few, short = 0 < len(settings) <= FEW, short_figures(shown)
        columns = [
            TableColumn(one.heading or "rank", one.heading, one.cells, short=not few)
            for one in named_columns(entries, self.under)
        ]
        columns[0] = replace(columns[0], figures={"rank": list(range(1, len(entries) + 1))})
        for key in settings:
            values = [run.overrides.get(key) for run in runs]
            columns.append(
                TableColumn(key, key, list(map(setting_text, values)), {key: values}, few)
            )
        texts, counts = list(map(training_seeds, entries)), [len(one.runs) for one in entries]
        seeds = {"training_seeds": counts}
        columns.append(TableColumn("training_seeds", "training seeds", texts, seeds))
        columns += [_figures(entries, one, short=one.key in short) for one in shown]
        return ResultTable(columns, CAPTION)


def _figures(entries: Sequence[Entry], column: Column, short: bool) -> TableColumn:
    """Return a column with intervals or deviations, or the numbers of drives."""
    name = column.key.replace("/", "_")
    found = [one.figures.get(column.key) for one in entries]
    texts = [figure_text(one, column) for one in entries]
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
        if column.has_interval:
            intervals = [interval_of(one, column) for one in entries]
            figures |= interval_figures(name, intervals)
            texts = [
                with_interval(one, column.form) + length_text(entry, column)
                for entry, one in zip(entries, intervals, strict=True)
            ]
    return TableColumn(name, column.heading, texts, figures, short)


def following(entries: Sequence[Entry]) -> list[str]:
    """Return the next command: the best driver on other roads, since few tracks chose it.

    Of results of the benchmark: whether the best is better than the next on the same roads.
    """
    if entries and entries[0].first.source == BENCHMARK:
        same = [
            one.first
            for one in entries
            if one.first.tracks.keys() == entries[0].first.tracks.keys()
        ]
        return ["compare", *(str(one.folder) for one in same[:2])] if len(same) > 1 else []
    if not entries or entries[0].first.source not in ("", EMBEDDED):
        return []
    best = entries[0].first
    is_run = best.val_mse is not None
    if not is_run and best.name == "-":  # the drive's file does not name the checkpoint
        return []
    return ["benchmark", str(best.folder) if is_run else best.name, "suite=quick"]


def print_ranking(ranking: Ranking, title: str, console: Console, page: str) -> None:
    """Print the table, and a line for each kind of unranked run.

    Args:
        ranking: ranking to print.
        title: title of the table.
        console: output of the table and the lines below it.
        page: file name of the HTML page, which has all columns.
    """
    if ranking.entries:
        table, left_out = ranking_table(ranking.entries, title, ranking.under, console.width)
        console.print(table)
        if left_out:
            line = left_out_line(left_out, console.width, page)
            console.print(line, highlight=False, markup=False, soft_wrap=True)
    if ranking.different:
        different = "; ".join(ranking.different)
        console.print(
            f"compare with care, the drives had different conditions: {different}",
            highlight=False,
            markup=False,
        )
    for line in unranked_lines(ranking.unranked, ranking.under):
        console.print(line, highlight=False, markup=False)
