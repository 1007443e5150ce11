"""Drive recipes of the board in a world of others: `python benchmarks/study.py carry`.

A script that sees the image alone drives CarRacing-v3; networks learn from its recordings, and
drive tracks that are none of them.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import kendalltau

from benchmarks.board_rows import BOARD, Row
from benchmarks.measuring import Rows, grouped
from benchmarks.study_grid import Entry, Study, kept
from zoo.checkpoints.policy_base import Policy, as_policy
from zoo.driving.drive_log import KeptFigures
from zoo.driving.run_drives import PolicyMaker, all_drives, load_kept
from zoo.driving.scenario import Scenario
from zoo.results.differences import read_entries
from zoo.runs.metrics_file import read_metrics_file
from zoo.scoring.track_scores import KeptDrive

WORLD, SPEED_MPH = "gymnasium:CarRacing-v3", 27.5
TRAINING, TEST = range(1000, 1040), range(20)  # seeds of tracks
DRAWS = 2000
ROWS = slice(64, 48, -2)  # of an image of 96 x 96, from the car on
GREY, MIDDLE, FULL = 20, 47.5, 20.0


@dataclass(frozen=True)
class Harder:
    """What makes a drive harder, after one of the board's axes.

    Attributes:
        noise: standard deviation of each value of the image.
        light: factor of each value.
        aside: pixels by which the image is moved to the right.
        late: frames by which the steering is late.
    """

    noise: float = 0.0
    light: float = 1.0
    aside: int = 0
    late: int = 0


# At these levels LeNet and PilotNet lost some of the tracks 1040 to 1051.
HARDER = Harder(noise=180), Harder(light=0.1), Harder(aside=10), Harder(late=2)


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
    """Record the script's drives, and return their folders."""
    folder = Path(study.config["runs"], "recordings")
    folders = [folder / str(seed) for seed in TRAINING]
    if not (folder / "done").is_file():
        keeps = [KeptDrive(path, record=True) for path in folders]
        all_drives(Script(), tracks(TRAINING), keeps, study.options.threads)
        (folder / "done").touch()
    return {"root": f"[{','.join(map(str, folders))}]"}


@dataclass(frozen=True)
class DisturbedCheckpoint(PolicyMaker):
    """What drives a checkpoint as `HARDER` says of the track's number."""

    checkpoint: str

    def policy(self, world: object, scenario: Scenario) -> Policy:
        """Return the driver, whose noise is drawn from the track's number."""
        policy, harder = load_kept(self.checkpoint).scored(), HARDER[scenario.seed % len(HARDER)]
        rng, waiting = np.random.default_rng(scenario.seed), deque([0.0] * harder.late)

        def drive(frame: np.ndarray, mph: float) -> tuple[float, None]:
            image = np.roll(frame, harder.aside, axis=1) * harder.light
            image += rng.normal(0, harder.noise, image.shape)
            waiting.append(policy(image.clip(0, 255).astype(np.uint8), mph).steering)
            return waiting.popleft(), None

        return as_policy(drive)


def carried_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a row of a run for each test track, with its return and the run's open-loop error."""

    def returns() -> dict:
        driver = DisturbedCheckpoint(str(entry.checkpoint(run)))
        drives = all_drives(driver, tracks(TEST), KeptFigures(), study.options.threads)
        return {"returns": [drive["episode_return"] for drive in drives]}

    error = read_metrics_file(run)["open_loop"]["val"]["balanced_mae"]
    for track, value in zip(TEST, kept(run / "carried.json", returns)["returns"], strict=True):
        yield {"track": track, "return": round(value, 2), "balanced_mae": round(error, 5)}


def board_scores(entry: str) -> np.ndarray:
    """Return which drives of the board were clean, float64 [seeds, roads]."""
    (read,) = read_entries(BOARD / entry)
    return read.scores(read.roads)


def on_board(rows: Rows) -> str:
    """Return an entry's share of clean drives on the board."""
    return f"{100 * board_scores(rows[0]['entry']).mean():.1f} %"


def agreement(rows: Rows, figure: str) -> str:
    """Return Kendall's tau of the returns and a figure, over recipes, with its 95 % interval.

    The interval is that of a bootstrap over recipes, tracks and training seeds.

    Args:
        rows: rows of all recipes.
        figure: `board`, the share of clean drives; or a column of the rows, the less the better.
    """
    pairs = []
    for trainings in grouped(rows, ["entry"]):
        of_seeds = grouped(trainings, ["seed"])
        returns = np.array([[float(row["return"]) for row in seed] for seed in of_seeds])
        if figure == "board":
            other = board_scores(trainings[0]["entry"])
        else:
            other = -np.array([[float(seed[0][figure])] for seed in of_seeds])
        pairs.append((returns, other))
    rng, same = np.random.default_rng(1), figure != "board"
    drawn = [_tau(pairs, same, rng) for _ in range(DRAWS)]
    low, high = np.nanpercentile(drawn, [2.5, 97.5])
    return f"{_tau(pairs, same):.2f} ({low:.2f} to {high:.2f})"


def _tau(
    pairs: list[tuple[np.ndarray, np.ndarray]], same: bool, rng: np.random.Generator | None = None
) -> float:
    """Return tau; with `rng` of recipes, seeds, tracks and roads drawn with replacement.

    The rows of both arrays of a pair are training seeds, `same` ones or others.
    """

    def drawn(count: int) -> np.ndarray:
        return np.arange(count) if rng is None else rng.integers(count, size=count)

    # A recipe that was drawn twice says nothing of an order.
    recipes, columns = set(drawn(len(pairs)).tolist()), [drawn(each.shape[1]) for each in pairs[0]]
    means = []
    for returns, other in (pairs[recipe] for recipe in sorted(recipes)):
        seeds = drawn(len(returns)), drawn(len(other))
        rows = (seeds[0], seeds[0]) if same else seeds
        matrices = zip((returns, other), rows, columns, strict=True)
        means.append([matrix[row][:, column].mean() for matrix, row, column in matrices])
    return float(kendalltau(*np.array(means).T)[0]) if len(means) > 1 else float("nan")
