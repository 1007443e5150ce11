"""What each study measures of its runs: rows of its table, and what must exist before it trains.

`ROWS` and `PREPARE` are named by the study's YAML. A function of `ROWS` drives what is missing, and
returns the rows of one entry whose trainings have finished.
"""

import csv
import itertools
import shlex
import shutil
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf
from rich.console import Console

from benchmarks.board_rows import Row, board_rows, pretrained_rows
from benchmarks.input_rows import input_rows
from benchmarks.road_rows import road_rows, root_of
from benchmarks.study_grid import Entry, Study, kept, run_logged, seconds_file
from benchmarks.warning_rows import warning_rows
from benchmarks.watched_drives import nominal
from datamodules.image import read_image
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.split import Split, rows_per_second, split_rows, without_gaps, write_split
from simulator.hand_control import REACTION_S
from zoo.base.bounded_files import read_json
from zoo.base.errors import InputError
from zoo.cli.compose import compose_config
from zoo.drives.drive_log import summarize
from zoo.drives.drive_record import Drive, DriveRow
from zoo.drives.speed_controller import PI, Constant, SpeedController
from zoo.runs.metrics_file import read_metrics_file
from zoo.worlds.run_drives import Keep, run_drives
from zoo.worlds.scenario import Scenario

console = Console(soft_wrap=True)
CHUNK_ROWS = 75  # five seconds: rows of a share are drawn in such pieces, not one by one
STALLED_S = 30.0
BLOCKS, GAP_S, SHARES = 10, 3.0, (0.1, 0.3, 1.0)  # of the road's rows
TRAIN, VAL, TEST = range(3)
OFFSET = 0.275  # of the side cameras' labels, also for networks trained with another one


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
            run_logged(log, ["simulator", "record", *words], study.options.threads)
    return {}


def per_run(measure: Callable[[Study, Entry, Path], Iterable[Row]]) -> Callable:
    """Return a function of all rows of an entry, from one of the rows of a run."""
    return lambda study, entry: [
        {**entry.labels, "seed": run.name, **row}
        for run in entry.finished
        for row in measure(study, entry, run)
    ]


def columns(figures: Mapping | None, prefix: str, names: Iterable[str], digits: int = 4) -> Row:
    """Return rounded figures, means of several drives; empty cells where there are none."""
    row: Row = {}
    for name in names:
        value = (figures or {}).get(name, "")
        value = value[0] if isinstance(value, list | tuple) else value
        row[f"{prefix}{name}"] = value if value == "" else round(value, digits)
    return row


def command(study: Study, entry: Entry, run: Path) -> Row:
    """Return the column with the command of a run."""
    words = ["drivezoo", "train", *study.command(entry), f"seed={run.name}"]
    return {"command": shlex.join(words)}


def result_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a run's row: its test rows, its laps of lake and mountain, and recoveries."""
    metrics, checkpoint = read_metrics_file(run), run / "checkpoints" / "best.ckpt"
    row: Row = {
        "split": OmegaConf.load(run / ".hydra" / "config.yaml").data.split,
        "parameters": metrics["parameters"],
        "epochs": metrics["epochs"],
        "train_s": round((metrics["seconds_per_epoch"] or 0) * metrics["epochs"], 1),
        "samples_per_second": round(metrics["samples_per_second"] or 0),
    }
    errors = ("mse", "mae", "balanced_mae", "bias")
    row |= columns(metrics["open_loop"]["test"], "test_", errors, 6)
    row |= columns(metrics["baselines"]["test"]["always zero"], "test_zero_", ("mse",), 6)
    for track in ("lake", "mountain"):
        driven = (metrics["drive"] or {}).get("tracks", {}).get(track)
        names = ("autonomy", "interventions", "cte_mean_m", "cte_max_m", "latency_ms")
        row |= columns(driven, f"{track}_", names)
    figures = kept(run / "recoveries.json", lambda: recovery_figures(checkpoint))
    yield row | columns(figures, "recoveries_", figures, 6) | command(study, entry, run)


@cache
def recoveries() -> tuple[np.ndarray, np.ndarray, list[list[np.ndarray]]]:
    """Return steering and speed of every third row of the recoveries, and frames by camera.

    These are laps of the lake which no training uses. The networks' own test rows differ by split
    and by the offset of the labels: they cannot be compared.
    """
    recording = read_recordings(swaying_laps("recoveries", "lake", 9))
    rows = np.arange(0, len(recording), 3)  # neighbours are alike
    frames = [[read_image(path) for path in paths] for paths in recording.images[rows].T]
    return recording.steering[rows], recording.speed_mph[rows], frames


def recovery_figures(checkpoint: Path) -> dict[str, float]:
    """Return a network's open-loop metrics on the recoveries.

    `mse`, `mae` and `balanced_mae` are of the centre camera. `side_mae` is of the side cameras,
    with the recorded steering corrected by `OFFSET` as label. `side_response` is that of
    `zoo.training.open_loop`.
    """
    from zoo.checkpoints.policy import load_policy
    from zoo.training.open_loop import open_loop_metrics, side_response

    policy = load_policy(str(checkpoint))
    true, speed, frames = recoveries()
    center, left, right = (
        np.array([policy(*pair)[0] for pair in zip(images, speed, strict=True)])
        for images in frames
    )
    figures = open_loop_metrics(center, true)
    sides = np.abs([left - (true + OFFSET), right - (true - OFFSET)])
    figures |= {"side_mae": float(sides.mean()), "side_response": side_response(left, right)}
    return {
        key: figures[key] for key in ("mse", "mae", "balanced_mae", "side_mae", "side_response")
    }


class LapFigures(Keep):
    """A drive's figures; those of a throttle that does not move the car are only `stalled_m`.

    Such a drive ends, since putting the car back at 0 mph would not help.
    """

    moved_s, stalled = 0.0, False

    def show(self, frame: object, row: DriveRow) -> bool:
        """Return whether the car has stood still for too long."""
        self.moved_s = row.time_s if row.speed_mph > 1 else self.moved_s
        self.stalled = row.time_s - self.moved_s > STALLED_S
        return self.stalled

    def result(self, drive: Drive, policy: object, world: object) -> dict:
        """Return the figures, or the distance in metres after which the car stood still."""
        return {"stalled_m": round(drive.driven_m)} if self.stalled else summarize(drive)


def lap(
    track: str, control: str = "hold 15 mph", frame_rate: float = 15.0, laps: float = 1.0
) -> tuple[Scenario, SpeedController | None]:
    """Return a drive from a track's first point, and its speed controller."""
    kind, text = control.removesuffix(" mph").split()
    value = float(text)
    if kind == "throttle":  # it starts at a standstill
        scenario = Scenario(track, laps=laps, throttle="network", frame_rate=frame_rate)
        return scenario, Constant(value)
    speed = PI(value, kp=0.5) if kind == "proportional" else None
    return Scenario(track, laps=laps, speed=value, frame_rate=frame_rate), speed


def driven(
    study: Study, entry: Entry, run: Path, **more: object
) -> list[tuple[dict, dict[str, float]]]:
    """Return settings and figures of the drives that the study's YAML lists for a run."""
    settings = [
        dict(zip(drives["axes"], values, strict=True)) | more
        for drives in study.config["drives"]
        if all(entry.labels[key] in names for key, names in drives.get("where", {}).items())
        for values in itertools.product(*drives["axes"].values())
    ]
    names = ("-".join(map(str, drive.values())).replace(" ", "_") for drive in settings)
    paths = [run / "drives" / f"{name}.json" for name in names]
    missing = [number for number, path in enumerate(paths) if not path.is_file()]
    laps = [lap(**settings[number]) for number in missing]
    checkpoint = str(run / "checkpoints" / "best.ckpt")
    scenarios, speeds = [scenario for scenario, _ in laps], [speed for _, speed in laps]
    keeps = [LapFigures() for _ in laps]
    workers = study.options.threads
    for place, figures in run_drives(checkpoint, scenarios, keeps, workers, speeds=speeds):
        kept(paths[missing[place]], lambda driven=figures: driven)
    return list(zip(settings, map(read_json, paths), strict=True))


def claim_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a row for each drive of a run."""
    names = ("autonomy", "interventions", "cte_mean_m", "cte_max_m", "speed_mph", "stalled_m")
    for settings, figures in driven(study, entry, run):
        yield {
            "experiment": entry.words[0].partition("=")[2],
            "training": "quick" if study.options.quick else "published",
            "weights": "imagenet" if entry.labels["recipe"] == "E" else "",
            **settings,
            **columns(figures, "", names),
        }


def transfer_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a run's row: errors on held-out rows, and its drives."""
    metrics, options = read_metrics_file(run), study.options
    with (run / "split.csv").open(newline="") as file:
        train_rows = sum(line["part"] == "train" for line in csv.DictReader(file))
    row: Row = {"samples": options.samples, "size": "x".join(map(str, options.size))}
    row["train_rows"] = train_rows
    for part, name in itertools.product(("val", "test"), ("mse", "balanced_mae")):
        row |= columns(metrics["open_loop"][part], f"{part}_", (name,), 6)
        row |= columns(metrics["baselines"][part]["always zero"], f"{part}_zero_", (name,), 6)
    laps = driven(study, entry, run, laps=options.laps) if options.laps else []
    row["laps"] = f"{options.laps:g}" if laps else ""
    figures = {settings["track"]: lap for settings, lap in laps}
    for track in study.config["drives"][0]["axes"]["track"]:
        names = ("autonomy", "interventions", "cte_mean_m")
        row |= columns(figures.get(track), f"{track}_", names)
    yield row | command(study, entry, run)


def first_try_rows(study: Study, entry: Entry, run: Path) -> Iterable[Row]:
    """Return a run's row: its seconds, and its lap."""
    lake = read_metrics_file(run)["drive"]["tracks"]["lake"]
    seconds = columns(read_json(run / "log_seconds.json"), "", ("wall_s", "cpu_s"), 0)
    yield seconds | columns(lake, "", ("autonomy", "interventions"))


def generator_rows(study: Study, entry: Entry) -> list[Row]:
    """Search for failures with each seed, and return a row for each search."""
    rows = []
    for run in entry.runs:
        out, words = run / "search", study.command(entry, "search")
        if not seconds_file(log := run / "log.txt").is_file():
            shutil.rmtree(out, ignore_errors=True)  # an interrupted search
            words = [*words, f"sampler={entry.labels['sampler']}", f"seed={run.name}", f"out={out}"]
            run_logged(log, ["zoo.search", entry.labels["network"], *words], study.options.threads)
            print(f"{run}: searched", flush=True)
        found = read_json(out / "search.json")
        row = {**entry.labels, "seed": run.name, "drives": len(found["drives"])}
        row |= {"failed": found["failed"], "cells": found["cells"]["failed"]}
        row["sparseness"] = "" if found["sparseness"] is None else round(found["sparseness"], 4)
        rows.append(row)
    return rows


PREPARE: dict[str, Callable[[Study], dict]] = {
    "bench_v1": lambda study: {"root": recorded(compose_config(["data=bench_v1"]))},
    "folds": folds,
    "nominal": nominal,
    "shares": shares,
    "student_laps": student_laps,
    "swaying_laps": lambda study: {"root": swaying_laps("swaying", "udacity_lake", 1)},
}
ROWS: dict[str, Callable[[Study, Entry], list[Row]]] = {
    "results": per_run(result_rows),
    "board": board_rows,
    "claims": per_run(claim_rows),
    "transfer": per_run(transfer_rows),
    "pretrained": pretrained_rows,
    "first_try": per_run(first_try_rows),
    "real_roads": road_rows,
    "inputs": per_run(input_rows),
    "warnings": warning_rows,
    "generators": generator_rows,
}
