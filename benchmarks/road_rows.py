"""A real road: cross-validated scores on the official test of Challenge 2, beside its teams'."""

import math
from pathlib import Path

import numpy as np

from benchmarks.board_rows import Row
from benchmarks.measuring import make_console
from benchmarks.study_grid import Entry, Study
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.driving.bootstrap import Estimate, poisson_rate
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.result_table import interval_figures
from zoo.scoring.challenge_score import (
    OfficialTest,
    baselines,
    read_column,
    read_test,
    score_challenge,
    team_angles,
)
from zoo.scoring.evaluate_options import ChallengeOptions


def root_of(study: Study) -> str:
    """Return the folder of the test.

    Raises:
        InputError: none is named.
    """
    if study.options.root is None:
        raise InputError("root=: name the folder of the test's frames, see docs/real_roads.md")
    return study.options.root


def road_rows(study: Study, entry: Entry) -> list[Row]:
    """Return the row of a network, or those of the baselines and the teams."""
    test, kind = read_test(root_of(study)), entry.labels["kind"]
    rows = np.arange(len(test.recording))
    unknown: Row = columns_of("replay_per_min", Estimate(math.nan), 2)
    if kind == "reference":
        known = baselines(test.angles, rows)
        known |= dict(team_angles(root_of(study), test.frame_ids))
        kinds = ["baseline"] * 3 + ["team"] * (len(known) - 3)
        return [
            {**entry.labels, "kind": one, "steering": name, **errors(test, angles), **unknown}
            for one, (name, angles) in zip(kinds, known.items(), strict=True)
        ]
    runs = entry.finished if entry.words else [entry.folder]
    if len(runs) < len(entry.runs):
        return []
    pooled: dict[str, float] = {}
    for run in runs:
        pooled |= submission_of(study, entry, run)
    angles = np.array([pooled[one] for one in test.frame_ids])
    row = {**entry.labels, **errors(test, angles), **unknown}
    if kind == "cross-validated":
        drives = [one for run in runs for one in read_metrics_file(run)["drive"]["drives"]]
        lost, driven_s = (sum(one[key] for one in drives) for key in ("interventions", "driven_s"))
        row |= columns_of("replay_per_min", poisson_rate(lost, driven_s / 60), 2)
    return [row]


def submission_of(study: Study, entry: Entry, run: Path) -> dict[str, float]:
    """Return the angles by frame of a run on its test rows, or of a packaged network on all."""
    out = run / "challenge"
    if not (out / "submission.csv").is_file():
        driver, split = entry.name.partition("_")[0], None
        if entry.words:
            driver = str(run / "checkpoints" / "best.ckpt")
        if entry.labels["kind"] == "cross-validated":
            split = str(run / "split.csv")
        options = ChallengeOptions(split=split, out=str(out))
        score_challenge(find_driver(driver), root_of(study), options, make_console())
    return read_column(out / "submission.csv", "steering_angle")


def errors(test: OfficialTest, angles: np.ndarray) -> Row:
    """Return the columns of both halves' errors."""
    columns: Row = {}
    for half, found in test.rmse(np.arange(len(angles)), angles).items():
        columns |= columns_of(f"{half}_rmse_rad", found, 6)
    return columns


def columns_of(name: str, figure: Estimate, digits: int) -> Row:
    """Return the columns of a figure and its interval, rounded; empty where it is not known."""
    return {
        key: "" if value is None else round(value, digits)
        for key, (value,) in interval_figures(name, [figure]).items()
    }
