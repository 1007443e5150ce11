"""The ranking as one page that fetches nothing: table, parallel coordinates, curves."""

import html
import json
from collections.abc import Sequence
from datetime import datetime
from importlib.resources import files
from pathlib import Path

from zoo.ranking import Entry, Unranked
from zoo.ranking_table import (
    Column,
    below,
    columns,
    is_named,
    run_name,
    said,
    seeds,
    setting_columns,
    shown_setting,
    unranked_lines,
)

# Of these less is better: their axes stand upside down, so that up is good everywhere.
LESS_IS_BETTER = ("cte", "interventions", "mse", "wall_s")
CURVES = ("drive/autonomy", "drive/cte_mean", "val/mse", "train/loss")


def write_page(
    path: Path, title: str, entries: Sequence[Entry], unranked: Sequence[Unranked], under: Path
) -> Path:
    """Write the page; raises OSError where that can't be.

    Args:
        title: its heading.
        entries: ranked, the best first.
        unranked: what could not be, named below the table.
        under: folders are said below it.
    """
    figures, settings = columns(entries), setting_columns(entries)
    data = {
        "axes": [*map(_setting_axis, settings), *map(_figure_axis, figures)],
        "entries": [_plain(entry, settings, figures, under) for entry in entries],
        "curves": [
            name for name in CURVES if any(name in r.curves for e in entries for r in e.runs)
        ],
    }
    parts = files("zoo") / "ranked_page"
    filled = (parts / "page.html").read_text()
    for name, text in {
        "title": html.escape(title),
        "when": f"{datetime.now():%Y-%m-%d %H:%M}",
        "where": html.escape(str(under.resolve())),
        "lead": html.escape(_lead(entries)),
        "table": _table(entries, settings, figures, under),
        "unranked": "".join(
            f"<p>{html.escape(one)}</p>" for one in unranked_lines(unranked, under)
        ),
        "style": (parts / "style.css").read_text(),
        "script": (parts / "page.js").read_text(),
        # Text in a script element ends at "</", which a folder's name may hold.
        "data": json.dumps(data).replace("</", "<\\/"),
    }.items():
        filled = filled.replace("{{" + name + "}}", text)
    path.write_text(filled)
    return path


def _lead(entries: Sequence[Entry]) -> str:
    """What the best came to, in a sentence."""
    if not entries:
        return "No run has finished."
    best, count = entries[0], sum(len(entry.runs) for entry in entries)
    what = f"{count} runs" if count > 1 else "1 run"
    if len(entries) < count:
        what += f", {len(entries)} settings with repeats by seed"
    for column in (
        Column("autonomy", "autonomy", "{:.1%}"),
        Column("validation MSE", "val_mse", "{:.4f}"),
    ):
        if best.figures.get(column.key):
            said_best = said(best.figures, column)
            return f"{what}. The best, {best.first.name}: {column.heading} {said_best}."
    return f"{what}."


def _table(
    entries: Sequence[Entry], settings: Sequence[str], figures: Sequence[Column], under: Path
) -> str:
    named = ["model"] if is_named(entries, settings) else []
    headings = ["", "run", *named, *settings, "seeds", *(one.heading for one in figures)]
    words = len(headings) - len(figures)
    head = "".join(
        f'<th scope="col"{" class=text" if place < words else ""}>{html.escape(heading)}</th>'
        for place, heading in enumerate(headings)
    )
    rows = []
    for place, entry in enumerate(entries, 1):
        cells = [str(place), run_name(entry, under), *([entry.first.name] if named else [])]
        cells += [shown_setting(entry.first.overrides.get(key)) for key in settings]
        cells.append(seeds(entry))
        cells += [said(entry.figures, column) for column in figures]
        values = [None] * words + [
            (entry.figures.get(column.key) or (None,))[0] for column in figures
        ]
        tds = "".join(
            f"<td{' class=text' if number < words else ''}"
            + (f' data-value="{value}"' if value is not None else "")
            + f">{html.escape(cell)}</td>"
            for number, (cell, value) in enumerate(zip(cells, values, strict=True))
        )
        rows.append(f'<tr data-entry="{place - 1}">{tds}</tr>')
    return f"<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody>"


def _setting_axis(key: str) -> dict:
    return {"key": key, "heading": key, "kind": "setting"}


def _figure_axis(column: Column) -> dict:
    less = any(word in column.key for word in LESS_IS_BETTER)
    share = "%" in column.form
    return {
        "key": column.key,
        "heading": column.heading,
        "kind": "figure",
        "less": less,
        "share": share,
    }


def _plain(entry: Entry, settings: Sequence[str], figures: Sequence[Column], under: Path) -> dict:
    """An entry as the page's script reads it."""
    values = {key: entry.first.overrides.get(key) for key in settings}
    values |= {one.key: entry.figures[one.key][0] for one in figures if entry.figures.get(one.key)}
    own = " ".join(f"{key}={shown_setting(values[key])}" for key in settings)
    return {
        "name": f"{run_name(entry, under)}: {own or entry.first.name}",
        "values": values,
        "runs": [
            {
                "folder": below(run.folder, under),
                "seed": run.seed,
                "curves": {
                    name: sorted(curve.items())
                    for name, curve in run.curves.items()
                    if name in CURVES
                },
            }
            for run in entry.runs
        ],
    }
