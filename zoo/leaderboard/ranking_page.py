"""The ranking as a result: printed, as a table for files, and as one self-contained page."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from rich.console import Console

from zoo.base.whole_file import write_output
from zoo.cli.closing_lines import print_written
from zoo.drives.drive_record import EMBEDDED
from zoo.evaluate.drives_table import with_deviation
from zoo.leaderboard.ranking import Entry, protocols, rank
from zoo.leaderboard.ranking_table import (
    Figure,
    figure_column,
    figure_columns,
    figure_text,
    folder_label,
    left_out_line,
    length_text,
    named_columns,
    ranking_table,
    run_name,
    seeds_column,
    setting_columns,
    short_figures,
    unranked_lines,
    value_of,
    wide_console,
)
from zoo.leaderboard.scored import BENCHMARK, Count, Unranked, read_scored
from zoo.runs.page import Page
from zoo.runs.table import Column, Table
from zoo.runs.table_files import Result

CURVES = ("drive/autonomy", "drive/cte_mean", "val/mse", "train/loss")
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
        title: title of the printed table.
        written: paths of the files written, the page first.
    """

    entries: list[Entry]
    unranked: list[Unranked]
    different: list[str]
    under: Path
    title: str = ""
    written: list[Path] = field(default_factory=list)

    @classmethod
    def read(
        cls, folders: Sequence[Path], under: Path, drives: Sequence[Path] = (), title: str = ""
    ) -> "Ranking":
        """Rank the runs of some folders, and drives together with them."""
        scored, unranked = read_scored(folders, drives)
        return cls(rank(scored), unranked, protocols(scored), under, title)

    def show(self) -> None:
        """Print the ranking and what was written."""
        console = wide_console()
        print_ranking(self, self.title, console, self.written[0].name)
        print_written(self.written, following(self.entries), console)

    def __repr__(self) -> str:
        best = f"; the best: {run_name(self.entries[0], self.under)}" if self.entries else ""
        return f"Ranking of {len(self.entries)} entries{best}"

    def result_table(self) -> Table:
        """Return a row for each entry, the best first."""
        entries, shown = self.entries, figure_columns(self.entries)
        settings, short = setting_columns(entries), short_figures(shown)
        few = 0 < len(settings) <= FEW
        columns = [
            *(replace(one, short=not few) for one in named_columns(entries, self.under)),
            *(replace(one, short=few) for one in settings),
            seeds_column(entries),
            *(figure_column(entries, one, one.key in short) for one in shown),
        ]
        return Table(columns, CAPTION)


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


def write_page(
    path: Path, title: str, entries: Sequence[Entry], unranked: Sequence[Unranked], under: Path
) -> Path:
    """Write the page and return its path.

    Args:
        path: file to write.
        title: heading of the page.
        entries: rows of the ranking, the best first.
        unranked: runs without figures, listed below the table.
        under: folder to which the runs' folders are shown relative.

    Raises:
        OSError: the file cannot be written.
    """
    figures, settings = figure_columns(entries), setting_columns(entries)
    texts = [*named_columns(entries, under), *settings, seeds_column(entries)]
    # Counts have no axis: it could not show of how many drives they are.
    axes = [one for one in figures if one.form]
    data = {
        "axes": [
            *({"key": one.name, "heading": one.name, "kind": "setting"} for one in settings),
            *map(_figure_axis, axes),
        ],
        "entries": [
            _script_entry(place, entry, settings, figures, under)
            for place, entry in enumerate(entries)
        ],
        "curves": [
            name for name in CURVES if any(name in r.curves for e in entries for r in e.runs)
        ],
    }
    page = render_page(
        title=title,
        where=f"{under.resolve()} \N{MIDDLE DOT} {datetime.now():%Y-%m-%d %H:%M}",
        lead=_lead(entries, under),
        heads=[(one.heading, True) for one in texts] + [(one.heading, False) for one in figures],
        rows=[
            [
                *((column.cells[place], None) for column in texts),
                *((figure_text(entry, one), value_of(entry, one)) for one in figures),
            ]
            for place, entry in enumerate(entries)
        ],
        data=data,
        unranked=unranked_lines(unranked, under),
    )
    return write_output(path, page, key="")


def render_page(
    title: str,
    where: str,
    lead: str,
    heads: Sequence[tuple[str, bool]],
    rows: Sequence[Sequence[tuple[str, float | None]]],
    data: dict,
    unranked: Sequence[str] = (),
) -> str:
    """Return a page with a table that sorts, parallel coordinates and curves.

    Args:
        title: heading of the page.
        where: line below the heading.
        lead: first sentences.
        heads: headings of the table, each with whether the column holds text.
        rows: rows of cells, each a text and the number to sort by (None: sort by the text).
        data: `axes`, `entries` and `curves` that the page's script draws.
        unranked: lines below the table.
    """
    return Page(Path(__file__).with_name("static") / "ranking.html", "ranking.js").render(
        title=title,
        where=where,
        lead=lead,
        heads=heads,
        rows=rows,
        unranked=unranked,
        data=data,
    )


def _counts_text(entry: Entry) -> str:
    """Return by track how many of an entry's drives had no intervention, as text."""
    texts = [
        f"{one.without_intervention} of {one.drives} on {Path(key).parent.stem}"
        for key, one in entry.figures.items()
        if isinstance(one, Count)
    ]
    return f"; drives without intervention: {', '.join(texts)}" if texts else ""


def _lead(entries: Sequence[Entry], under: Path) -> str:
    """Return the page's first sentences: number of runs, the best run and its figure."""
    if not entries:
        return "No run has finished."
    best, count = entries[0], sum(len(entry.runs) for entry in entries)
    trained = [one for one in entries if one.first.val_mse is not None]
    noun = "run" if trained else "score"
    what = f"{count} {noun}s" if count > 1 else f"1 {noun}"
    if len(entries) < count:
        what += f", grouped by training seed into {len(entries)} settings"
    for column in (
        Figure("autonomy", "autonomy", "{:.1%}"),
        Figure("validation MSE", "val_mse", "{:.4f}"),
    ):
        if best.figures.get(column.key):
            figure = with_deviation(best.figures[column.key], column.form, len(best.runs))
            figure += length_text(best, column)
            name = best.first.name if best in trained else run_name(best, under)
            counts = _counts_text(best)
            return f"{what}. The best, {name}: {column.heading} {figure}{counts}."
    return f"{what}."


def _figure_axis(column: Figure) -> dict:
    share = "%" in column.form
    return {
        "key": column.key,
        "heading": column.heading,
        "kind": "figure",
        "less": column.less,  # draws the axis upside down, so that up is better on every axis
        "share": share,
    }


def _script_entry(
    place: int,
    entry: Entry,
    settings: Sequence[Column],
    figures: Sequence[Figure],
    under: Path,
) -> dict:
    """Return an entry in the form that the page's script reads."""
    values = {one.name: one.figures[one.name][place] for one in settings}
    values |= {one.key: value_of(entry, one) for one in figures if value_of(entry, one) is not None}
    own = " ".join(f"{one.name}={one.cells[place]}" for one in settings)
    return {
        "name": f"{run_name(entry, under)}: {own or entry.first.name}",
        "values": values,
        "runs": [
            {
                "folder": folder_label(run.folder, under),
                "seed": run.seed,
                "curves": {
                    name: sorted(pair for pair in curve.items() if math.isfinite(pair[1]))
                    for name, curve in run.curves.items()
                    if name in CURVES
                },
            }
            for run in entry.runs
        ],
    }
