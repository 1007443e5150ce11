"""The ranking as one self-contained HTML page: table, parallel coordinates, curves."""

import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from zoo.base.whole_file import write_output
from zoo.evaluate.drives_table import with_deviation
from zoo.leaderboard.ranking import Count, Entry, Unranked
from zoo.leaderboard.ranking_table import (
    Figure,
    figure_columns,
    figure_text,
    folder_label,
    length_text,
    named_columns,
    run_name,
    seeds_column,
    setting_columns,
    unranked_lines,
    value_of,
)
from zoo.runs.page import Page
from zoo.runs.table import Column

CURVES = ("drive/autonomy", "drive/cte_mean", "val/mse", "train/loss")


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
