"""Group what is ranked by training seed, and sort it, the best driver first.

Sweeps and the leaderboard use it. Runs without a drive rank below all runs with one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zoo.evaluate.drives_table import mean_and_deviation
from zoo.leaderboard.scored import Scored
from zoo.runs.record_fields import Spread

LAST = float("inf")  # sorts after every figure
WHOLE_LAP = 0.95  # laps; a drive that ends a little before its start counts as a lap
LAP_M = 1000.0  # where the laps are unknown; the included circuits are longer


@dataclass(frozen=True)
class Entry:
    """A row of the ranking: a run, or several that differ only in their training seed.

    Attributes:
        figures: by `autonomy`, `cte_m`, `val_mse`, ..., and by `TRACK/autonomy`, ..., mean and
            sample deviation over the training seeds; by `TRACK/drives`, share of the drives without
            an intervention. None where a run lacks the figure.
        counts: by track, number of drives without an intervention and of drives.
    """

    runs: tuple[Scored, ...]
    figures: dict[str, Spread | None]
    counts: dict[str, tuple[int, int]]

    @property
    def first(self) -> Scored:
        """Return the run with the lowest training seed."""
        return self.runs[0]

    def short_drive(self, track: str = "") -> str:
        """Return the length of the shortest drives of less than a lap, such as `0.1 laps`.

        Args:
            track: track of the drives; empty for any.

        Returns:
            The length; empty if all drives are as long as a lap, or their length is unknown.
        """
        tracks = [pair for run in self.runs for pair in run.tracks.items()]
        driven = [figures for name, figures in tracks if track in ("", name)]
        laps = min((one["laps"] for one in driven if "laps" in one), default=LAST)
        if laps < WHOLE_LAP:
            return f"{laps:.2g} laps"
        metres = min(
            (one.get("driven_m", LAST) for one in driven if "laps" not in one), default=LAST
        )
        return f"{metres:.0f} m" if metres < LAP_M else ""


def rank(runs: Sequence[Scored]) -> list[Entry]:
    """Sort runs by autonomy, then cross-track error, then validation MSE.

    Drives of less than a lap come after all that are longer: most roads are easy at their start.
    Repeats with other training seeds form one entry. Where runs were driven on different tracks,
    only the tracks that all of them share count.
    """
    groups: dict[str, list[Scored]] = {}
    for run in runs:
        groups.setdefault(run.settings or str(run.folder.resolve()), []).append(run)
    driven = [run.tracks for run in runs if run.tracks]
    shared = set(driven[0]).intersection(*driven) if driven else set()
    return sorted((_entry(group, shared) for group in groups.values()), key=_order)


def _entry(runs: Sequence[Scored], shared: set[str]) -> Entry:
    runs = sorted(runs, key=lambda run: (run.seed is None, run.seed))
    figures = {
        key: _spread([getattr(run, key) for run in runs])
        for key in ("val_mse", "test_mse", "wall_s")
    }
    figures["autonomy"] = _spread([run.mean("autonomy", shared) for run in runs])
    figures["cte_m"] = _spread([run.mean("cte_mean_m", shared) for run in runs])
    counts = {}
    for track in dict.fromkeys(name for run in runs for name in run.tracks):
        own = [run.tracks.get(track, {}) for run in runs]
        for key in dict.fromkeys(key for one in own for key in one):
            figures[f"{track}/{key}"] = _spread([one.get(key) for one in own])
        if all(track in run.counts for run in runs):
            clean, drives = np.sum([run.counts[track] for run in runs], axis=0).tolist()
            counts[track] = clean, drives
            figures[f"{track}/drives"] = (clean / drives, None) if drives else None
    return Entry(tuple(runs), figures, counts)


def _spread(values: Sequence[float | None]) -> Spread | None:
    return None if None in values else mean_and_deviation(values)


def _order(entry: Entry) -> tuple:
    autonomy, cte, mse = (entry.figures[key] for key in ("autonomy", "cte_m", "val_mse"))
    return (
        autonomy is None,
        bool(entry.short_drive()),
        -autonomy[0] if autonomy else LAST,
        cte[0] if cte else LAST,
        mse[0] if mse else LAST,
        str(entry.first.folder),
    )
