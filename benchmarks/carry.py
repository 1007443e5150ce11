"""Drive recipes of the board in a world of others: `python benchmarks/study.py carry`.

A script that sees the image alone drives CarRacing-v3; networks learn from its recordings, and
drive tracks that are none of them.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.board_rows import Row
from benchmarks.study_grid import Entry, Study
from zoo.base.bounded_files import read_json
from zoo.base.whole_file import json_text, write_whole
from zoo.checkpoints.policy_base import Policy, as_policy
from zoo.driving.run_drives import PolicyMaker, all_drives
from zoo.driving.scenario import Scenario
from zoo.runs.metrics_file import read_metrics_file
from zoo.scoring.track_scores import KeptDrive

WORLD, SPEED_MPH = "gymnasium:CarRacing-v3", 20.0
TRAINING, TEST = range(1000, 1040), range(20)  # seeds of tracks
LEAST = 500.0  # return of a recorded drive; in others the script has lost the road
ROWS = slice(64, 48, -2)  # of an image of 96 x 96, from the car on
GREY, MIDDLE, FULL = 20, 47.5, 20.0


class Script(PolicyMaker):
    """A driver that follows the grey road upwards from the car, and steers to its middle."""

    def policy(self, world: object, scenario: Scenario) -> Policy:
        """Return the driver; where it sees no road, it keeps its last steering."""
        last = 0.0

        def drive(frame: np.ndarray, mph: float) -> tuple[float, None]:
            nonlocal last
            if (middle := ahead(frame)) is not None:
                last = float(np.clip((middle - MIDDLE) / FULL, -1, 1))
            return last, None

        return as_policy(drive)


def ahead(frame: np.ndarray) -> float | None:
    """Return the column of the road's middle ahead of the car; None where no road is seen."""
    image, middle = frame.astype(int), None
    for row in image[ROWS]:
        columns = np.flatnonzero((np.ptp(row, axis=1) < GREY) & (abs(row.mean(1) - 104) < GREY))
        pieces = np.split(columns, np.flatnonzero(np.diff(columns) > 1) + 1)
        middles = [piece.mean() for piece in pieces if len(piece) > 2]
        if middles:
            middle = min(middles, key=lambda column: abs(column - (middle or MIDDLE)))
    return middle


def tracks(seeds: Iterable[int]) -> list[Scenario]:
    """Return a drive on the track of each seed."""
    return [Scenario(world=WORLD, seed=seed, speed=SPEED_MPH) for seed in seeds]


def record_tracks(study: Study) -> dict[str, str]:
    """Record the script's drives, and return the folders of those that kept the road."""
    folder = Path(study.config["runs"], "recordings")
    returns = folder / "returns.json"
    if not returns.is_file():
        keeps = [KeptDrive(folder / str(seed), record=True) for seed in TRAINING]
        drives = all_drives(Script(), tracks(TRAINING), keeps, study.options.threads)
        figures = [drive["episode_return"] for drive in drives]
        write_whole(returns, json_text(dict(zip(map(str, TRAINING), figures, strict=True))))
    kept = [str(folder / seed) for seed, value in read_json(returns).items() if value >= LEAST]
    return {"root": f"[{','.join(kept)}]"}


def carried_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a row of a run for each test track, with its return and the run's open-loop error."""
    path, keep = run / "carried.json", KeptDrive(None)
    if not path.is_file():
        checkpoint = str(run / "checkpoints" / "last.ckpt")
        drives = all_drives(checkpoint, tracks(TEST), keep, study.options.threads)
        write_whole(path, json_text([drive["episode_return"] for drive in drives]))
    error = read_metrics_file(run)["open_loop"]["val"]["balanced_mae"]
    for track, value in zip(TEST, read_json(path), strict=True):
        yield {"track": track, "return": round(value, 2), "balanced_mae": round(error, 5)}
