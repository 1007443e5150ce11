"""Recordings and splits that must exist before a study trains; `PREPARE` is named by its YAML."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf
from rich.console import Console

from benchmarks.road_rows import root_of
from benchmarks.study_grid import Study, run_logged
from benchmarks.watched_drives import nominal
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.split import Split, rows_per_second, split_rows, without_gaps, write_split
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.simulator.hand_control import REACTION_S

console = Console(soft_wrap=True)
CHUNK_ROWS = 75  # five seconds: rows of a share are drawn in such pieces, not one by one
BLOCKS, GAP_S, SHARES = 10, 3.0, (0.1, 0.3, 1.0)  # of the road's rows
TRAIN, VAL, TEST = range(3)


def recorded(config: object) -> str:
    """Return the folder of the recording of a config; record it if it does not exist.

    Raises:
        InputError: the recording was changed.
    """
    from zoo.training.run_config import with_recording

    return str(with_recording(OmegaConf.create(config), console).data.root)


def swaying_laps(name: str, track: str, seed: int) -> str:
    """Return the folder of laps by an expert that sways off its line, and returns."""
    passes = [{"track": track, "direction": "both", "laps": 1, "noise": 1.0, "seed": seed}]
    record = {"out": f"outputs/recordings/{name}", "passes": passes}
    return recorded({"data": {"root": None, "record": record}})


def shares(study: Study) -> dict[str, int]:
    """Write the splits that hold shares of the training rows, and return the samples of an epoch.

    Raises:
        InputError: the samples are fewer than a batch in each epoch.
    """
    samples = study.options.samples // 4
    if samples < 32:
        raise InputError(f"samples={4 * samples}: is less than a batch per epoch; set more")
    recording = read_recordings(recorded(compose_config(["data=udacity_lake"])))
    whole = split_rows(recording)
    for share, (word,) in study.config["grids"][0]["axes"]["share"].items():
        path = Path(word.partition("=")[2])
        path.parent.mkdir(parents=True, exist_ok=True)
        write_split(path, recording, reduced(recording, whole, share))
    return {"samples_per_epoch": samples}


def folds(study: Study) -> dict[str, str]:
    """Write the splits of five folds, each with three shares of its training rows.

    Of ten blocks two are test rows, and one validates.
    """
    recording, name = read_recordings(root_of(study)), "fold-{}-{:.0f}.csv"
    block = np.arange(len(recording)) * BLOCKS // len(recording)
    gap, half = round(GAP_S * rows_per_second(recording)), BLOCKS // 2
    Path(study.config["runs"]).mkdir(parents=True, exist_ok=True)
    for fold in range(half):
        part = np.where(block == (fold + 2) % BLOCKS, VAL, TRAIN)
        part[block % half == fold] = TEST
        kept = without_gaps(part, recording.recording, gap)
        whole = Split(*(np.flatnonzero(kept == one) for one in range(3)))
        for share in SHARES:
            path = Path(study.config["runs"], name.format(fold + 1, 100 * share))
            write_split(path, recording, reduced(recording, whole, share))
    return {}


def reduced(recording: Recording, split: Split, share: float) -> Split:
    """Return a split with a share of the training rows, in pieces of consecutive rows.

    The rows of a smaller share are among those of a larger one.
    """
    breaks = (np.diff(split.train) > 1) | (np.diff(recording.recording[split.train]) != 0)
    runs = np.split(split.train, np.flatnonzero(breaks) + 1)
    chunks = [run[at : at + CHUNK_ROWS] for run in runs for at in range(0, len(run), CHUNK_ROWS)]
    order = np.random.default_rng(0).permutation(len(chunks))
    sizes = np.cumsum([len(chunks[number]) for number in order])
    count = int(np.searchsorted(sizes, share * len(split.train))) + 1
    chosen = np.concatenate([chunks[number] for number in order[:count]])
    return Split(np.sort(chosen), split.val, split.test)


def student_laps(study: Study) -> dict[str, str]:
    """Record the laps of simulated students that the chosen entries lack."""
    for control in {entry.labels["recording"] for entry in study.chosen()} & REACTION_S.keys():
        folder = Path(study.config["runs"], "recordings", control)
        if not (folder / "driving_log.csv").is_file():
            words = [f"control={control}", f"laps={study.options.laps}", "seed=1", "track=lake"]
            words += [f"speed={study.options.speed}", f"out={folder}"]
            log = folder.parent / f"{control}.txt"
            run_logged(log, ["zoo.commands.simulator", "record", *words], study.options.threads)
    return {}


PREPARE: dict[str, Callable[[Study], dict]] = {
    "bench_v1": lambda study: {"root": recorded(compose_config(["data=bench_v1"]))},
    "folds": folds,
    "nominal": nominal,
    "shares": shares,
    "student_laps": student_laps,
    "swaying_laps": lambda study: {"root": swaying_laps("swaying", "udacity_lake", 1)},
}
