"""Read a track's figures (mean and spread over drives) from a file of any version."""

import math
from collections.abc import Mapping

Spread = tuple[float, float | None]  # mean; sample standard deviation, None without one
# Figures that are one number for all drives, or of some drives only: earlier versions wrote a wrong
# deviation for them.
ONE_FIGURE = ("m_per_intervention", "expert_steering_per_s", "lap_s")


def read_figures(figures: Mapping, drives: int | None) -> dict[str, Spread | int | None]:
    """Return a track's figures from a file of this or an earlier version.

    Earlier versions did not write `drives`, and wrote the population deviation. It is converted if
    the number of drives is known, and left out otherwise.

    Args:
        figures: result of `mean_and_spread`, or `[mean, population deviation]` by key.
        drives: number of start seeds in an earlier version's run; None if not known.

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
