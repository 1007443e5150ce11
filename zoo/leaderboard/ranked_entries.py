"""The result of `drivezoo leaderboard`: its table, and how it is printed."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from zoo.drives.drive_record import EMBEDDED
from zoo.leaderboard.ranked_drive import read_drives
from zoo.leaderboard.ranking import Count, Entry, Unranked, protocols, rank, read_runs
from zoo.leaderboard.ranking_table import (
    Column,
    figure_columns,
    figure_text,
    left_out_line,
    named_columns,
    ranking_table,
    run_name,
    setting_columns,
    setting_text,
    training_seeds,
    unranked_lines,
)
from zoo.runs.result_table import Cell, Result, ResultTable


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
        names = named_columns(self.entries, self.under)
        settings, figures = setting_columns(self.entries), figure_columns(self.entries)
        rows, cells = [], []
        for place, entry in enumerate(self.entries):
            row: dict[str, Cell] = {(one.heading or "rank"): one.cells[place] for one in names}
            row |= {"rank": place + 1, "training_seeds": len(entry.runs)}
            row |= {key: entry.first.overrides.get(key) for key in settings}
            for one in figures:
                row |= _figures(entry, one)
            rows.append(row)
            texts = [one.cells[place] for one in names]
            texts += [setting_text(entry.first.overrides.get(key)) for key in settings]
            texts.append(training_seeds(entry))
            cells.append(texts + [figure_text(entry.figures, one) for one in figures])
        headings = [*(one.heading for one in names), *settings, "training seeds"]
        return ResultTable(rows, headings + [one.heading for one in figures], cells)


def _figures(entry: Entry, column: Column) -> dict[str, Cell]:
    """Return a figure of an entry by its name, with its deviation or its number of drives."""
    name, figure = column.key.replace("/", "_"), entry.figures.get(column.key)
    if isinstance(figure, Count):
        return {name: figure.drives, f"{name}_without_intervention": figure.without_intervention}
    value, deviation = figure or (None, None)
    return {name: value, f"{name}_std": deviation}


def following(entries: Sequence[Entry]) -> list[str]:
    """Return the next command: more start seeds for the best driver, which was chosen by few."""
    if not entries or entries[0].first.source not in ("", EMBEDDED):
        return []
    best = entries[0].first
    is_run = best.val_mse is not None
    if not is_run and best.name == "-":  # the drive's file does not name the checkpoint
        return []
    tracks = [f"track={','.join(best.tracks)}"] if best.tracks else []
    return ["evaluate", str(best.folder) if is_run else best.name, *tracks, "seeds=5"]


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
