"""Group what is ranked by training seed, and sort it, the best driver first.

Sweeps and the leaderboard use it. Runs without a drive rank below all runs with one.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from zoo.drives.drive_record import REPLAY, SOCKET
from zoo.drives.metrics import leaderboard_metrics
from zoo.evaluate.drives_table import mean_and_deviation
from zoo.leaderboard.scored import BENCHMARK, LENGTHS, Count, Scored
from zoo.runs.record_fields import Spread

LAST = float("inf")  # sorts after every figure
WHOLE_LAP = 0.95  # laps; a drive that ends a little before its start counts as a lap
LAP_M = 1000.0  # where the laps are unknown; the included circuits are longer


@dataclass(frozen=True)
class Entry:
    """A row of the ranking: a run, or several that differ only in their training seed.

    Attributes:
        figures: by `autonomy`, `cte_m`, `val_mse`, ..., mean and sample deviation over the training
            seeds; by `TRACK/drives`, the `Count` of all drives. None where a run lacks the figure.
    """

    runs: tuple[Scored, ...]
    figures: dict[str, Spread | Count | None]

    @property
    def first(self) -> Scored:
        """Return the run with the lowest training seed."""
        return self.runs[0]

    def short_drive(self, track: str | None = None) -> str:
        """Return the length of the shortest drives of less than a lap, such as `0.1 laps`.

        Args:
            track: track of the drives; None for any.

        Returns:
            The length; empty if all drives are as long as a lap, or their length is unknown.
        """
        driven = [
            one for run in self.runs for name, one in run.tracks.items() if track in (None, name)
        ]
        laps = [one["laps"] for one in driven if "laps" in one]
        metres = [one["driven_m"] for one in driven if "laps" not in one and "driven_m" in one]
        if laps and min(laps) < WHOLE_LAP:
            return f"{min(laps):.2g} laps"
        return f"{min(metres):.0f} m" if metres and min(metres) < LAP_M else ""


def rank(runs: Sequence[Scored]) -> list[Entry]:
    """Sort runs by autonomy, then cross-track error, then validation MSE.

    Drives of less than a lap come after all that are longer: most roads are easy at their start.
    Repeats with other training seeds form one entry. Where runs were driven on different tracks,
    only the tracks that all of them share count.
    """
    groups: dict[str, list[Scored]] = {}
    for run in runs:
        groups.setdefault(run.settings, []).append(run)
    shared = shared_tracks(runs)
    entries = [_entry(group, shared) for group in groups.values()]
    return sorted(entries, key=_order)


def shared_tracks(runs: Sequence[Scored]) -> list[str]:
    """Return the tracks on which every run with a drive was driven."""
    driven = [run.tracks for run in runs if run.tracks]
    return [name for name in (driven[0] if driven else {}) if all(name in one for one in driven)]


def protocols(runs: Sequence[Scored]) -> list[str]:
    """Return descriptions of how the runs were driven; none where it is the same for all."""
    found = {f"{', '.join(run.tracks)} {_conditions(run)}" for run in runs if run.tracks}
    return sorted(found) if len(found) > 1 else []


def _conditions(run: Scored) -> str:
    """Return where a run was driven, and at what speed."""
    if run.source == REPLAY:
        return "in a replay"
    if run.source == BENCHMARK:
        return "in the benchmark"
    how = f"at {run.mph:g} mph" if run.mph else "with its own throttle"
    if not run.mph and run.val_mse is None:
        how = "at a speed that its file does not name"  # an evaluation
    return f"on a socket {how}" if run.source == SOCKET else how


def _entry(runs: Sequence[Scored], shared: Sequence[str]) -> Entry:
    runs = sorted(runs, key=lambda run: (run.seed is None, run.seed))
    figures = {
        key: _spread([getattr(run, key) for run in runs])
        for key in ("val_mse", "test_mse", "wall_s")
    }
    for key, track_key in (("autonomy", "autonomy"), ("cte_m", "cte_mean_m")):
        values = [_over_tracks(run, shared, track_key) for run in runs]
        figures[key] = _spread(values)
    shown = [one.name for one in leaderboard_metrics()]
    for track in dict.fromkeys(name for run in runs for name in run.tracks):
        for key in (*shown, *LENGTHS[:2]):
            values = [run.tracks.get(track, {}).get(key) for run in runs]
            figures[f"{track}/{key}"] = _spread(values)
        counts = [run.counts.get(track) for run in runs]
        figures[f"{track}/drives"] = None
        if all(counts):
            totals = (sum(column) for column in zip(*map(astuple, counts), strict=True))
            figures[f"{track}/drives"] = Count(*totals)
    return Entry(tuple(runs), figures)


def _over_tracks(run: Scored, shared: Sequence[str], key: str) -> float | None:
    tracks = [one for name, one in run.tracks.items() if not shared or name in shared]
    values = [one[key] for one in tracks if key in one]  # null where nothing was driven
    return float(np.mean(values)) if values and len(values) == len(tracks) else None


def _spread(values: Sequence[float | None]) -> Spread | None:
    if not values or any(value is None for value in values):
        return None
    return mean_and_deviation(values)


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
