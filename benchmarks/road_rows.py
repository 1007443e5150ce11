"""A real road: cross-validated scores on the official test of Challenge 2, beside its teams'."""

from pathlib import Path

import numpy as np

from benchmarks.board_rows import Row
from benchmarks.measuring import make_console
from benchmarks.study_grid import Entry, Study
from datamodules.recording_format import read_recordings
from datamodules.split import Split, rows_per_second, without_gaps, write_split
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.evaluate.challenge import (
    OfficialTest,
    baselines,
    read_column,
    read_test,
    score_challenge,
    team_angles,
)
from zoo.evaluate.evaluate_options import ChallengeOptions
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.table import interval_figures

BLOCKS, GAP_S = 10, 3.0
TRAIN, VAL, TEST = range(3)


def root_of(study: Study) -> str:
    """Return the folder of the test.

    Raises:
        InputError: none is named.
    """
    if study.options.root is None:
        raise InputError("root=: name the folder of the test's frames, see docs/real_roads.md")
    return study.options.root


def folds(study: Study) -> dict[str, str]:
    """Write a split for each fold: of ten blocks two are test rows, and one validates."""
    recording = read_recordings(root_of(study))
    block = np.arange(len(recording)) * BLOCKS // len(recording)
    gap, half = round(GAP_S * rows_per_second(recording)), BLOCKS // 2
    for fold in range(half):
        part = np.where(block == (fold + 2) % BLOCKS, VAL, TRAIN)
        part[block % half == fold] = TEST
        kept = without_gaps(part, recording.recording, gap)
        path = Path(study.config["runs"], f"fold-{fold + 1}.csv")
        path.parent.mkdir(parents=True, exist_ok=True)
        write_split(path, recording, Split(*(np.flatnonzero(kept == one) for one in range(3))))
    return {}


def road_rows(study: Study, entry: Entry) -> list[Row]:
    """Return the row of a network, or those of the baselines and the teams."""
    test, kind = read_test(root_of(study)), entry.labels["kind"]
    rows = np.arange(len(test.recording))
    if kind == "reference":
        known = baselines(test.angles, rows)
        known |= dict(team_angles(root_of(study), test.frame_ids))
        kinds = ["baseline"] * 3 + ["team"] * (len(known) - 3)
        return [
            {"kind": one, "steering": name, **errors(test, angles), "replay_per_min": ""}
            for one, (name, angles) in zip(kinds, known.items(), strict=True)
        ]
    runs = entry.finished if entry.words else [entry.folder]
    if len(runs) < len(entry.runs):
        return []
    pooled: dict[str, float] = {}
    for run in runs:
        pooled |= submission_of(study, entry, run)
    replays = [read_metrics_file(run)["drive"] for run in entry.finished]
    lost = sum(drive["interventions"] for replay in replays for drive in replay["drives"])
    minutes = sum(drive["driven_s"] for replay in replays for drive in replay["drives"]) / 60
    angles = np.array([pooled[one] for one in test.frame_ids])
    return [
        {
            **entry.labels,
            **errors(test, angles),
            "replay_per_min": lost / minutes if minutes else "",
        }
    ]


def submission_of(study: Study, entry: Entry, run: Path) -> dict[str, float]:
    """Return the angles by frame of a run on its test rows, or of a packaged network on all."""
    out = run / "challenge"
    if not (out / "submission.csv").is_file():
        driver, split = entry.name.partition("_")[0], None
        if entry.words:
            driver, split = str(run / "checkpoints" / "best.ckpt"), str(run / "split.csv")
        options = ChallengeOptions(split=split, out=str(out))
        score_challenge(find_driver(driver), root_of(study), options, make_console())
    return read_column(out / "submission.csv", "steering_angle")


def errors(test: OfficialTest, angles: np.ndarray) -> Row:
    """Return the columns of both halves' errors."""
    rmse = test.rmse(np.arange(len(angles)), angles)
    columns = {f"{half}_rmse_rad": found for half, found in rmse.items()}
    return {
        name: round(value, 6)
        for key, found in columns.items()
        for name, (value,) in interval_figures(key, [found]).items()
    }
