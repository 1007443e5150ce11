"""The ranking as a result: printed, as a table for files, and as one self-contained page."""

import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

from rich.console import Console

from zoo.base.bounded_files import read_regular
from zoo.base.console_script import SWEEP_RECORD
from zoo.base.errors import InputError
from zoo.base.output_files import overwriting
from zoo.base.terminal import print_line, print_written, printable
from zoo.base.whole_file import write_output
from zoo.driving.drive_record import EMBEDDED
from zoo.results.ranking import (
    Entry,
    Figure,
    folder_label,
    in_one_column,
    named_columns,
    rank,
    ranked_figures,
    ranking_table,
    run_name,
    seeds_column,
    setting_columns,
    short_figures,
)
from zoo.results.scored import BENCHMARK, Unranked, read_scored
from zoo.runs.page import Page, last_folders
from zoo.runs.result_table import Column, Table
from zoo.runs.table_files import Result

# A page with a table that sorts, parallel coordinates and curves; its values:
# heads: headings of the table, each with whether the column holds text.
# rows: rows of cells, each a text and the number to sort by (None: sort by the text).
# more: titles of tables that a reader unfolds, and the tables.
# data: `axes`, `entries` and `curves` that the script draws.
PAGE = Page(Path(__file__).with_name("static") / "ranking.html", "ranking.js")
CURVES = ("drive/autonomy", "drive/cte_mean", "val/mse", "train/loss")
CAPTION = (
    "Ranking, {}. In brackets: 95 % interval over training seeds (Student's t); ±: sample "
    "standard deviation over training seeds."
)
FEW = 3  # settings that have columns of their own, and stand for the run's folder in a TeX table
WIDTH = 140  # of a table that is not printed on a terminal
SIGNED = b"<!-- written by drivezoo; without this line: "  # begin of a page's last line
MOST_PAGE_BYTES = 200_000_000
NAMED = 5  # unranked runs that a line names; it counts the others


@dataclass(frozen=True, repr=False)
class Ranking(Result):
    """Ranked runs and drives.

    Attributes:
        entries: rows of the ranking, the best first.
        unranked: runs without figures.
        under: folder to which the runs' folders are shown relative.
        title: title of the printed table.
        written: paths of the files written, the page first.
        notes: what a paper does not have, and why.
    """

    entries: list[Entry]
    unranked: list[Unranked]
    under: Path
    title: str = ""
    written: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def read(
        cls, folders: Sequence[Path], under: Path, drives: Sequence[Path] = (), title: str = ""
    ) -> "Ranking":
        """Rank the runs of some folders, and drives together with them."""
        scored, unranked = read_scored(folders, drives)
        return cls(rank(scored), unranked, under, title)

    @property
    def order(self) -> str:
        """Return which entry comes first, in words; see `rank`."""
        if not self.entries:
            return "no run has finished"
        score, mse = self.entries[0].score, self.entries[0].figures["val_mse"]
        driven = [set(run.tracks) for entry in self.entries for run in entry.runs if run.tracks]
        apart = ", but on different tracks" if driven and not set.intersection(*driven) else ""
        if score:
            error = "none drives: the smallest cross-track error"
            return f"{'the best driver' if score[0] > 0 else error} first{apart}"
        why = "no autonomy was measured" if driven else "nothing was driven"
        return f"{why}: {'the lowest validation MSE first' if mse else 'sorted by folder'}"

    def show(self, console: Console | None = None) -> None:
        """Print the ranking, a line for each kind of unranked run, and what was written."""
        console = console or wide_console()
        if self.entries:
            title = ", ".join(filter(None, [self.title, self.order]))
            table, left_out = ranking_table(self.entries, title, self.under, console.width)
            console.print(table)
            if left_out:
                line = f"not shown in {console.width} characters: {'; '.join(left_out)}"
                console.print(line, highlight=False, markup=False, soft_wrap=True)
        for line in self.unranked_lines():
            print_line(console, line)
        for line in self.notes:
            print_line(console, printable(line))
        print_written(self.written, following(self.entries), console)

    def __repr__(self) -> str:
        best = f"; the best: {run_name(self.entries[0], self.under)}" if self.entries else ""
        return f"Ranking of {len(self.entries)} entries{best}"

    def result_table(self) -> Table:
        """Return a row for each entry, the best first."""
        figures, settings = ranked_figures(self.entries), setting_columns(self.entries)
        short, few = short_figures(figures), 0 < len(settings) <= FEW
        columns = [
            *(replace(column, short=not few) for column in named_columns(self.entries, self.under)),
            *(replace(setting, short=few) for setting in settings),
            seeds_column(self.entries),
            *(figure.column(figure.key in short) for figure in figures),
        ]
        return Table(columns, CAPTION.format(self.order))

    def unranked_lines(self) -> list[str]:
        """Return a line for each kind, such as `2 failed: 3 (no space left), 7 (...)`."""
        lines = []
        for why in dict.fromkeys(run.why for run in self.unranked):
            named = [
                folder_label(run.folder, self.under) + (f" ({run.reason})" if run.reason else "")
                for run in self.unranked
                if run.why == why
            ]
            rest = f" and {len(named) - NAMED} more" if len(named) > NAMED else ""
            lines.append(printable(f"{len(named)} {why}: {', '.join(named[:NAMED])}{rest}"))
        return lines

    def write_page(self, path: Path, title: str) -> Path:
        """Write the page and return its path.

        Raises:
            UsageError: another file, or a page that was edited, must not be replaced.
            InputError: the file cannot be written.
        """
        entries, figures = self.entries, ranked_figures(self.entries)
        settings = setting_columns(entries)
        shown = [in_one_column(settings)] if len(settings) > FEW else settings
        names = [*named_columns(entries, self.under), *shown, seeds_column(entries)]
        cells: list[list[tuple[str, float | None]]]
        cells = [[(cell, None) for cell in column.cells] for column in names]
        cells += [list(zip(figure.texts, figure.values, strict=True)) for figure in figures]
        axes: list[dict[str, str | bool]] = [
            {"key": setting.name, "heading": setting.name, "kind": "setting"}
            for setting in settings
        ]
        axes += [
            {
                "key": figure.key,
                "heading": figure.heading,
                "kind": "figure",
                "less": figure.less,  # draws the axis upside down: up is better on every axis
                "share": "%" in figure.form,
            }
            for figure in figures
            if figure.form  # counts have no axis: it could not show of how many drives they are
        ]
        # A curve of one epoch would be a dot in an empty plane.
        runs = [run for entry in entries for run in entry.runs]
        curves = {name for run in runs for name, curve in run.curves.items() if len(curve) > 1}
        where = last_folders(self.under.resolve())
        page = PAGE.render(
            title=title,
            where=f"{where} \N{MIDDLE DOT} {datetime.now():%Y-%m-%d %H:%M}",
            lead=f"{self.order[0].upper()}{self.order[1:]}.",
            heads=[(column.heading, True) for column in names]
            + [(figure.heading, False) for figure in figures],
            rows=list(zip(*cells, strict=True)),
            more=[],
            data={
                "axes": axes,
                "entries": [
                    self._scripted(place, entry, settings, figures)
                    for place, entry in enumerate(entries)
                ],
                "curves": [name for name in CURVES if name in curves],
            },
            unranked=self.unranked_lines(),
        )
        text = page.encode(errors="backslashreplace")
        with overwriting((path.parent / SWEEP_RECORD).is_file() or _is_page(path)):
            return write_output(path, text + SIGNED + _digest(text), key="")

    def _scripted(
        self, place: int, entry: Entry, settings: Sequence[Column], figures: Sequence[Figure]
    ) -> dict:
        """Return an entry in the form that the page's script reads."""
        values = {setting.name: setting.figures[setting.name][place] for setting in settings}
        values |= {figure.key: figure.values[place] for figure in figures}
        own = " ".join(f"{setting.name}={setting.cells[place]}" for setting in settings)
        return {
            "name": f"{run_name(entry, self.under)}: {own or entry.first.name}",
            "values": values,
            "runs": [
                {
                    "folder": folder_label(run.folder, self.under),
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


def following(entries: Sequence[Entry]) -> list[str]:
    """Return the next command: the best driver on other roads, since few tracks chose it.

    Of results of the benchmark: whether the best is better than the next on the same roads.
    """
    if not entries:
        return []
    best = entries[0].first
    if best.source == BENCHMARK:
        others = (entry.first for entry in entries[1:])
        same = next((entry for entry in others if entry.tracks.keys() == best.tracks.keys()), None)
        return ["compare", str(best.folder), str(same.folder)] if same else []
    driver = best.name if best.val_mse is None else str(best.folder)
    if best.car:  # no road shows it
        return ["replay", driver, "FOLDER"]
    is_known = driver != "-" and best.source in ("", EMBEDDED)
    return ["benchmark", driver, "suite=quick"] if is_known else []


def wide_console() -> Console:
    """Return a console as wide as the terminal; without a terminal, wide enough for tables."""
    is_known = Console().is_terminal or "COLUMNS" in os.environ
    return Console(soft_wrap=True, emoji=False, width=None if is_known else WIDTH)


def _is_page(path: Path) -> bool:
    """Return whether a file is a page as it was written: its last line has its SHA-256."""
    try:
        text, signed, digest = read_regular(path, MOST_PAGE_BYTES).rpartition(SIGNED)
    except (OSError, InputError):
        return False
    return bool(signed) and digest == _digest(text)


def _digest(page: bytes) -> bytes:
    return f"sha256 {hashlib.sha256(page).hexdigest()} -->\n".encode()
