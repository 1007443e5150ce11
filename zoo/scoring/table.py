"""The figures of several drives as one table: mean and spread over the drives of a track."""

import numpy as np
from rich.markup import escape
from rich.table import Table

# The order of the table; what each means is in the README, under Scoring.
ROWS = {
    "autonomy": ("autonomy", "{:.1%}"),
    "interventions": ("interventions", "{:.1f}"),
    "m_per_intervention": ("metres per intervention", "{:.0f}"),
    "laps": ("laps", "{:.2f}"),
    "lap_s": ("lap time, s", "{:.1f}"),
    "cte_mean_m": ("cross-track error, mean, m", "{:.2f}"),
    "cte_rms_m": ("cross-track error, RMS, m", "{:.2f}"),
    "cte_max_m": ("cross-track error, max, m", "{:.2f}"),
    "beyond_1m": ("time beyond 1 m", "{:.1%}"),
    "steering_per_s": ("steering change, 1/s", "{:.2f}"),
    "expert_steering_per_s": ("  the expert's", "{:.2f}"),
    "speed_mph": ("speed, mph", "{:.1f}"),
    "stalled": ("time stalled", "{:.1%}"),
    "latency_ms": ("latency, median, ms", "{:.1f}"),
}
WITHOUT = {"m_per_intervention": "no intervention", "lap_s": "no whole lap"}


def mean_and_spread(drives: list[dict]) -> dict[str, tuple[float, float] | None]:
    """Mean and standard deviation over drives of every figure; None where none of them has it.

    Metres per intervention are those of all drives by the interventions of all: one drive without
    any would make the mean infinite.

    >>> mean_and_spread([{"autonomy": 1.0, "lap_s": None}, {"autonomy": 0.5, "lap_s": 90.0}])
    {'autonomy': (0.75, 0.25), 'lap_s': (90.0, 0.0)}
    """
    found = {}
    for key in drives[0]:
        if key in ("track", "seed", "nan_frames"):
            continue
        values = [one[key] for one in drives if one[key] is not None]
        found[key] = (float(np.mean(values)), float(np.std(values))) if values else None
    if found.get("m_per_intervention"):
        driven, lost = (sum(one[key] for one in drives) for key in ("driven_m", "interventions"))
        found["m_per_intervention"] = driven / lost, 0.0
    return found


def nan_line(drives: list[dict]) -> str | None:
    """Return what to say of drives in which the policy steered NaN; None where none has.

    >>> nan_line([{"track": "lake", "seed": 0, "nan_frames": 7}]).split(":")[0]
    'the network steered NaN in 7 frames (lake-0)'
    """
    bad = [one for one in drives if one.get("nan_frames")]
    if not bad:
        return None
    frames = sum(one["nan_frames"] for one in bad)
    names = ", ".join(dict.fromkeys(f"{one['track']}-{one['seed']}" for one in bad))
    return (
        f"the network steered NaN in {frames:,} frames ({names}): the car went straight on there, "
        "and the figures say nothing of the network; train again with a smaller optim.lr"
    )


def drives_table(tracks: dict[str, dict]) -> Table:
    """A column for each track, from `mean_and_spread`; rows that no track has are left out."""
    table = Table("driving", *map(escape, tracks))
    for key, (label, form) in ROWS.items():
        if not any(key in figures for figures in tracks.values()):
            continue
        cells = []
        for figures in tracks.values():
            if figures.get(key) is None:
                cells.append(WITHOUT.get(key, "-"))
                continue
            mean, spread = figures[key]
            cells.append(form.format(mean) + (f" ± {form.format(spread)}" if spread else ""))
        table.add_row(label, *cells)
    return table
