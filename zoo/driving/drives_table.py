"""Figures of several drives as one table: mean and deviation over the drives of a track."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from rich.console import Console

from zoo.base.terminal import counted
from zoo.driving.intervals import ONE_TRACK
from zoo.driving.metrics import DRIVES, METRICS
from zoo.runs.record_fields import Spread
from zoo.runs.result_table import Column, Table

DEVIATION = f"±: sample standard deviation over start seeds. {ONE_TRACK}"
SHORT = ("autonomy", "drives_without_intervention", "drives", "cte_mean_m")  # in TeX
# Rows of the table of drives that are counts over drives, not metrics of a drive.
COUNTS = {
    "drives_without_intervention": ("drives without intervention", ""),
    "drives": ("drives (start seeds)", "{}"),
}


def mean_and_deviation(values: Sequence[float]) -> Spread:
    """Return the mean and the sample standard deviation (n - 1), which is None for one value.

    >>> mean_and_deviation([1.0, 3.0]), mean_and_deviation([1.0])
    ((2.0, 1.4142135623730951), (1.0, None))
    """
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else None


def mean_and_spread(drives: list[dict]) -> dict[str, Spread | int | None]:
    """Return the mean and sample standard deviation of every metric, and the number of drives.

    A metric that no drive has is None. A metric that only some drives have, such as the lap time,
    has a mean and no deviation. Metres per intervention are the sum of the distances divided by the
    sum of the interventions, since one drive without an intervention would make a mean infinite.

    >>> mean_and_spread([{"autonomy": 1.0, "lap_s": None}, {"autonomy": 0.5, "lap_s": 90.0}])
    {'drives': 2, 'autonomy': (0.75, 0.3535533905932738), 'lap_s': (90.0, None)}
    """
    figures: dict[str, Spread | int | None] = {"drives": len(drives)}
    if "interventions" in drives[0] and any(
        drive.get("autonomy", 1) is not None for drive in drives
    ):
        lost = [drive["interventions"] for drive in drives]
        figures["drives_without_intervention"] = sum(not count for count in lost)
    for key in dict.fromkeys(key for drive in drives for key in drive if key in METRICS):
        shown = [drive[key] for drive in drives if drive.get(key) is not None]
        values = [value for value in shown if math.isfinite(value)]
        mean, deviation = mean_and_deviation(values) if values else (math.nan, None)
        figures[key] = (mean, deviation if len(values) == len(drives) else None) if values else None
    for key, metric in METRICS.items():
        if metric.pool and figures.get(key):
            figures[key] = metric.pool(drives), None
    return figures


def nan_line(drives: list[dict]) -> str | None:
    """Return a warning if the policy steered NaN in a drive, else None.

    >>> nan_line([{"track": "lake", "seed": 0, "nan_frames": 7}]).split(":")[0]
    'the driver steered NaN in 7 frames (lake-0)'
    """
    bad = [drive for drive in drives if drive.get("nan_frames")]
    if not bad:
        return None
    frames = sum(drive["nan_frames"] for drive in bad)
    names = ", ".join(dict.fromkeys(f"{drive['track']}-{drive['seed']}" for drive in bad))
    return (
        f"the driver steered NaN in {counted(frames, 'frame')} ({names}): the car was steered "
        "straight on instead, so that these figures are not the driver's; train a network again "
        "with a smaller optim.lr"
    )


def tied_line(drives: Sequence[dict]) -> str | None:
    """Return a line if drives differ on another processor, else None.

    >>> tied_line([{"tied": "opengl draws the frames"}])
    'another kind of processor gives other figures: opengl draws the frames'
    """
    reasons = dict.fromkeys(drive["tied"] for drive in drives if drive.get("tied"))
    line = f"another kind of processor gives other figures: {', '.join(reasons)}"
    return line if reasons else None


def with_deviation(figure: Spread, form: str, drives: int | None = None) -> str:
    """Return a formatted mean with its deviation, and the number of drives if given.

    A deviation of None or 0 is not shown.

    >>> with_deviation((0.982, 0.004), "{:.1%}", 3), with_deviation((0.982, None), "{:.1%}", 1)
    ('98.2% ± 0.4% (n = 3)', '98.2%')
    """
    mean, deviation = figure
    if not deviation:
        return form.format(mean)
    number = f" (n = {drives})" if drives else ""
    return f"{form.format(mean)} ± {form.format(deviation)}{number}"


def table_rows(table: str = DRIVES) -> dict[str, tuple[str, str]]:
    """Return the rows of a table in order: heading and format of the value, by key.

    Args:
        table: DRIVES, or REPLAYS for the metrics of a replay, without counts of drives.
    """
    rows = {key: metric.row(table) for key, metric in METRICS.items() if table in metric.tables}
    if table == DRIVES:
        first = next(iter(rows))
        rows = {first: rows[first], **COUNTS, **rows}
    return rows


def drives_table(tracks: dict[str, dict], table: str = DRIVES) -> Table:
    """Return a table with a column for each track, without the rows that no track has.

    Args:
        tracks: figures of each track by its name, as `mean_and_spread` returns them.
        table: DRIVES or REPLAYS.
    """
    has_deviation = table == DRIVES and any(track.get("drives", 1) > 1 for track in tracks.values())
    rows = table_rows(table)
    figures = [column for column in figure_columns(tracks, table) if column.name in rows]
    columns = [Column("track", "driving", list(tracks)), *figures]
    return Table(columns, DEVIATION if has_deviation else "").turned()


def print_drives(tracks: dict[str, dict], console: Console, table: str = DRIVES) -> None:
    """Print `drives_table`."""
    turned = drives_table(tracks, table)
    console.print(turned.printed(whole=[0], caption=turned.caption or None, caption_justify="left"))


def figure_columns(tracks: Mapping[str, Mapping], table: str = DRIVES) -> list[Column]:
    """Return a column for each figure that a track has, with a row for each track.

    Args:
        tracks: figures of each track by its name, as `mean_and_spread` returns them.
        table: table whose rows come first, DRIVES or REPLAYS.
    """
    rows = table_rows(table)
    rows |= {key: metric.row(table) for key, metric in METRICS.items() if key not in rows}
    columns = []
    for key, (label, form) in rows.items():
        if any(key in figures for figures in tracks.values()):
            texts = [figure_text(figures, key, form) for figures in tracks.values()]
            numbers = [figures.get(key) for figures in tracks.values()]
            values: dict[str, Sequence[float | int | None]] = {key: numbers}
            if key in METRICS:
                means, deviations = zip(*[pair or (None, None) for pair in numbers], strict=True)
                values = {key: means, f"{key}_std": deviations}
            columns.append(Column(key, label, texts, values, short=key in SHORT))
    return columns


def figure_text(figures: Mapping, key: str, form: str, drives: int | None = None) -> str:
    """Return a figure of `mean_and_spread` as `with_deviation`, or what stands for none."""
    if figures.get(key) is None:
        return METRICS[key].without if key in METRICS else "-"
    if key == "drives":
        return str(figures[key])
    if key == "drives_without_intervention":
        return f"{figures[key]} of {figures['drives']}"
    return with_deviation(figures[key], form, drives)
