"""A track's figures in `metrics.json`: mean and spread over its drives, of any version."""

import math
from collections.abc import Mapping

Spread = tuple[float, float | None]  # mean; sample standard deviation, None without one
# Earlier versions wrote a deviation of what is one figure for all drives, or of some drives only.
ONE_FIGURE = ("m_per_intervention", "expert_steering_per_s", "lap_s")


def read_figures(figures: Mapping, drives: int | None) -> dict[str, Spread | int | None]:
    """Return a track's figures from a file of this or an earlier version.

    Earlier versions wrote no `drives` and the population deviation: it is converted where the
    number of drives is known, and left out where it is not.

    Args:
        figures: as `mean_and_spread` returns them, or `[mean, population deviation]` by key.
        drives: number of start seeds that an earlier version drove with; None if not known.

    >>> read_figures({"autonomy": [0.9, 0.1], "interventions": [1, 1]}, 2)
    {'autonomy': (0.9, 0.14142135623730953), 'interventions': (1, 1.4142135623730951), 'drives': 2}
    >>> read_figures({"autonomy": [1.0, 0.0], "interventions": [0, 0.0]}, None)
    {'autonomy': (1.0, None), 'interventions': (0, None)}
    """
    if "drives" in figures:
        return {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in figures.items()
        }
    scale = math.sqrt(drives / (drives - 1)) if drives and drives > 1 else None
    found: dict[str, Spread | int | None] = {}
    for key, value in figures.items():
        if value is None:
            found[key] = None
            continue
        known = scale and value[1] is not None and key not in ONE_FIGURE
        found[key] = value[0], value[1] * scale if known else None
    if drives:
        found["drives"] = drives
        lost = found.get("interventions")
        if isinstance(lost, tuple) and (lost[0] == 0 or drives == 1):
            found["drives_without_intervention"] = drives if lost[0] == 0 else 0
    return found
