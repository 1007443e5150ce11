"""Measure what ImageNet weights help: `python benchmarks/transfer.py [samples=64000] [seeds=3]`.

It trains EfficientNet-Lite0 on 10, 30 and 100 % of the training rows of a recording: from scratch,
with frozen random blocks, with frozen ImageNet blocks, and fine-tuned from ImageNet. All trainings
draw the same number of samples and have the same validation and test rows. After the trainings
each network drives the track of the recording and one that no training uses.

The script writes `docs/transfer.csv`, one training per line, and from it the figure and the table
of `docs/models/efficientnet_lite0.md`; `runs=false` writes these alone. Runs are kept in
`outputs/transfer`. Finished trainings and drives are not repeated, so that an interrupted command
resumes; figure and table then name what was not run.
"""

import csv
import itertools
import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf
from rich.console import Console

from benchmarks.csv_table import write_table
from benchmarks.results import train_logged
from benchmarks.transfer_page import CSV, SETTINGS, SHARES, TRACKS, read_csv, write_page
from datamodules.recording import Recording, read_recordings
from datamodules.split import Split, split_rows, write_split
from simulator.command_line import read_options
from zoo.base.errors import InputError

RUNS = Path("outputs/transfer")
CHUNK_ROWS = 75  # five seconds: rows of a share are drawn in such pieces, not one by one
EPOCHS = 4  # each draws a quarter of the samples
BATCH = 32
ALL_BLOCKS = 17
OVERRIDES = {
    "scratch": ("model.weights=null", f"model.trainable_blocks={ALL_BLOCKS}"),
    "frozen random": ("model.weights=null", "model.trainable_blocks=0"),
    "frozen ImageNet": ("model.weights=imagenet", "model.trainable_blocks=0"),
    "fine-tuned ImageNet": (
        "model.weights=imagenet",
        f"model.trainable_blocks={ALL_BLOCKS}",
        "optim.backbone_lr=0.0001",
    ),
}
# No augmentation and no mirrored images, which features of frozen blocks could not have. The
# recording has both directions of the track.
COMMON = (
    "model=efficientnet_lite0",
    "augment=[]",
    "data.flip=0",
    "schedule=cosine",
    "callbacks=published",
    "callbacks.best.monitor=train/loss",
    "optim.lr=0.001",
    f"data.batch_size={BATCH}",
    "score=none",
)


@dataclass(frozen=True)
class TransferOptions:
    """Options of the runs.

    Args:
        samples: number of samples that each training draws.
        seeds: number of training seeds.
        size: height and width of the view, pixels.
        laps: laps of each drive; 0 does not drive.
        only: part of the names of settings; null for all.
        shares: shares of the training rows, of 0.1, 0.3 and 1.
        threads: number of OpenMP threads of a training.
        runs: whether to train; false writes figure and table from `docs/transfer.csv` alone.
    """

    samples: int = 64_000
    seeds: int = 3
    size: tuple[int, int] = (80, 256)
    laps: float = 1.0
    only: str | None = None
    shares: tuple[float, ...] = SHARES
    threads: int = 2
    runs: bool = True


@dataclass(frozen=True)
class Training:
    """One training of the study."""

    setting: str
    share: float
    seed: int

    def folder(self, options: TransferOptions) -> Path:
        """Return the run's folder; options that change its figures are in its name."""
        height, width = options.size
        length = f"{options.samples}-{height}x{width}"
        name = f"{self.setting.replace(' ', '_')}-{100 * self.share:.0f}"
        return RUNS / length / name / str(self.seed)

    def words(self, options: TransferOptions) -> list[str]:
        """Return the overrides of `drivezoo train`."""
        return [
            *COMMON,
            "data=udacity_lake",
            *OVERRIDES[self.setting],
            f"model.cache_features={'true' if 'frozen' in self.setting else 'false'}",
            f"model.size=[{','.join(map(str, options.size))}]",
            f"data.split={split_file(self.share)}",
            f"data.samples_per_epoch={options.samples // EPOCHS}",
            f"trainer.max_epochs={EPOCHS}",
            f"seed={self.seed}",
        ]


def split_file(share: float) -> Path:
    """Return the path of the split that holds a share of the training rows."""
    return RUNS / f"split-{100 * share:.0f}.csv"


def write_splits() -> None:
    """Write the splits; record the track if that was not done before."""
    from zoo.cli.compose import compose_config
    from zoo.training.embedded_recording import with_recording

    config = OmegaConf.create(compose_config(["data=udacity_lake"]))
    root = with_recording(config, Console(soft_wrap=True)).data.root
    recording = read_recordings(root)
    RUNS.mkdir(parents=True, exist_ok=True)
    whole = split_rows(recording)
    for share in SHARES:
        write_split(split_file(share), recording, reduced(recording, whole, share))


def reduced(recording: Recording, split: Split, share: float) -> Split:
    """Return a split with a share of the training rows, in pieces of consecutive rows.

    The rows of a smaller share are among those of a larger one.
    """
    breaks = (np.diff(split.train) > 1) | (np.diff(recording.recording[split.train]) != 0)
    runs = np.split(split.train, np.flatnonzero(breaks) + 1)
    chunks = [run[at : at + CHUNK_ROWS] for run in runs for at in range(0, len(run), CHUNK_ROWS)]
    order = np.random.default_rng(0).permutation(len(chunks))
    sizes = np.cumsum([len(chunks[one]) for one in order])
    count = int(np.searchsorted(sizes, share * len(split.train))) + 1
    chosen = np.concatenate([chunks[one] for one in order[:count]])
    return Split(np.sort(chosen), split.val, split.test)


def trainings(options: TransferOptions) -> list[Training]:
    """Return all trainings, seed by seed, so that a stopped command has whole comparisons."""
    seeds = range(1, options.seeds + 1)
    chosen = [name for name in SETTINGS if (options.only or "") in name]
    return [
        Training(setting, share, seed)
        for seed, share, setting in itertools.product(seeds, options.shares, chosen)
    ]


def drive_file(folder: Path, track: str, laps: float) -> Path:
    """Return the path of a drive's figures."""
    return folder / f"transfer-{track}-{laps:g}.json"


def csv_row(training: Training, options: TransferOptions) -> dict:
    """Return a training's line of `docs/transfer.csv`; cells of missing drives are empty."""
    folder = training.folder(options)
    metrics = json.loads((folder / "metrics.json").read_text())
    with (folder / "split.csv").open(newline="") as file:
        train_rows = sum(line["part"] == "train" for line in csv.DictReader(file))
    row = {
        "setting": training.setting,
        "share": training.share,
        "seed": training.seed,
        "samples": options.samples,
        "size": "x".join(map(str, options.size)),
        "train_rows": train_rows,
    }
    for part, name in itertools.product(("val", "test"), ("mse", "balanced_mae")):
        row[f"{part}_{name}"] = round(metrics["open_loop"][part][name], 6)
        row[f"{part}_zero_{name}"] = round(metrics["baselines"][part]["always zero"][name], 6)
    files = {track: drive_file(folder, track, options.laps) for track in TRACKS}
    driven = {
        track: json.loads(file.read_text()) for track, file in files.items() if file.is_file()
    }
    row["laps"] = f"{options.laps:g}" if driven else ""
    for track, name in itertools.product(TRACKS, ("autonomy", "interventions", "cte_mean_m")):
        row[f"{track}_{name}"] = round(driven[track][name], 4) if track in driven else ""
    return row | {"command": shlex.join(["drivezoo", "train", *training.words(options)])}


def merge(rows: list[dict]) -> list[dict]:
    """Return the lines of `docs/transfer.csv`, with new ones in place of their older versions."""

    def key(row: dict) -> tuple:
        place = SETTINGS.index(row["setting"]), float(row["share"]), int(row["seed"])
        return int(row["samples"]), row["size"], *place

    kept = {key(row): row for row in read_csv()} if CSV.is_file() else {}
    kept |= {key(row): row for row in rows}
    return [kept[name] for name in sorted(kept)]


def write_csv(rows: list[dict]) -> None:
    """Write `docs/transfer.csv`."""
    write_table(CSV, rows)


def make_runs(options: TransferOptions) -> None:
    """Train and drive what is missing; write `docs/transfer.csv` after each step.

    Raises:
        InputError: a training failed.
    """
    write_splits()
    chosen = trainings(options)
    for training in chosen:
        folder = training.folder(options)
        if not (folder / "metrics.json").is_file():
            if train_logged(folder, training.words(options), options.threads):
                raise InputError(f"{folder}: the training failed; see its log.txt")
            print(f"{folder}: finished", flush=True)
        write_csv(merge([csv_row(training, options)]))
    # All rows first: these drives say most if the command is stopped.
    by_share = sorted(chosen, key=lambda one: -one.share)
    for track, training in itertools.product(TRACKS if options.laps else (), by_share):
        path = drive_file(training.folder(options), track, options.laps)
        if not path.is_file():
            drive_and_keep(path, track, options.laps)
        write_csv(merge([csv_row(training, options)]))


def drive_and_keep(path: Path, track: str, laps: float) -> None:
    """Drive the best checkpoint beside `path`, and write the figures there."""
    import torch

    from zoo.base.whole_file import json_text, write_whole
    from zoo.evaluate.many_drives import Setup, drive_once

    torch.set_num_threads(1)  # one frame is too little work for two threads
    checkpoint = path.parent / "checkpoints" / "best.ckpt"
    figures = drive_once(str(checkpoint), Setup(track, laps=laps), None)
    write_whole(path, json_text(figures))
    print(f"{path}: autonomy {figures['autonomy']:.3f}", flush=True)


def main(arguments: list[str]) -> None:
    """Make the runs, then write figure and table.

    Raises:
        InputError: an option is wrong, or a training failed.
    """
    options = read_options(TransferOptions, arguments)
    if not set(options.shares) <= set(SHARES):
        raise InputError(f"shares={list(options.shares)}: name shares of {list(SHARES)}")
    if options.samples < EPOCHS * BATCH:
        raise InputError(f"samples={options.samples}: is less than a batch per epoch; set more")
    if options.runs:
        make_runs(options)
    print(", ".join(map(str, [CSV, *write_page(read_csv())])))


if __name__ == "__main__":
    from zoo.cli.run_command import run_command

    sys.exit(run_command("transfer", main, sys.argv[1:]))
