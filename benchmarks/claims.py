"""Test what write-ups claim: `python benchmarks/claims.py [real=FOLDER] [only=C] [quick=true]`.

It trains the published recipes on one track alone: on laps of the embedded expert on
`udacity_lake`, and on the recording of the original simulator that `real` names. Each checkpoint
drives a lap of `udacity_lake` and one of `udacity_jungle`, which no training uses, with the speed
control of its write-up. The 41-parameter network also drives at other frame rates.

The script writes `docs/claims.csv`, one drive per line, and from it the tables and the plot of
`docs/claims.md`; `runs=false` writes these alone. Runs are kept in `outputs/claims`. Finished
trainings and drives are not repeated, so that an interrupted command resumes.
"""

import csv
import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

from benchmarks.claims_page import CSV, write_page
from benchmarks.csv_table import write_table
from benchmarks.results import train_logged
from simulator.command_line import read_options
from zoo.base.errors import InputError
from zoo.drives.drive_record import DriveRow

RUNS = Path("outputs/claims")
TRACKS = ("udacity_lake", "udacity_jungle")
FRAME_RATE = 15.0  # Hz; the expert records at this rate
FRAME_RATES = (5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 50.0)
RECIPES = {
    "A": "pilotnet",
    "B": "pilotnet_gray",
    "C": "tiny41",
    "D": "commaai",
    "E": "vgg",
}
# Speed controls of the write-ups. 9 mph is the set speed of the course's own driver.
COURSE = "hold 9 mph"
CONTROLS = {"C": ("throttle 0.2", "throttle 0.3", "proportional 9 mph")}
FIGURES = ("autonomy", "interventions", "cte_mean_m", "cte_max_m", "speed_mph")
STALLED = "stalled_m"  # distance at which the car stands for good; empty if it does not
STALLED_S = 30.0


@dataclass(frozen=True)
class ClaimOptions:
    """Options of the runs.

    Args:
        real: folder of a recording of the original simulator; null for none.
        weights: file of VGG16's ImageNet weights; null trains recipe E from random weights.
        only: letters of the recipes to run, such as `AC`; null for all.
        seeds: number of training seeds.
        quick: whether to cut each training with `quick=true`; the publications' length if not.
        threads: number of OpenMP threads of a training, and of processes that drive.
        runs: whether to train and drive; false writes the page from `docs/claims.csv` alone.
    """

    real: str | None = None
    weights: str | None = None
    only: str | None = None
    seeds: int = 3
    quick: bool = False
    threads: int = 2
    runs: bool = True


@dataclass(frozen=True)
class Drive:
    """One drive of one training; `setting` distinguishes the drives of a training."""

    track: str
    control: str
    frame_rate: float = FRAME_RATE

    @property
    def name(self) -> str:
        return f"{self.track}-{self.control.replace(' ', '_')}-{self.frame_rate:g}"


def drives_of(recipe: str) -> Iterator[Drive]:
    """Return the drives of a recipe's checkpoints."""
    for track in TRACKS:
        for control in CONTROLS.get(recipe, (COURSE,)):
            yield Drive(track, control)
    if recipe == "C":
        for rate in FRAME_RATES:
            if rate != FRAME_RATE:
                yield Drive(TRACKS[0], CONTROLS["C"][0], rate)


def train(recipe: str, data: str, seed: int, options: ClaimOptions) -> Path:
    """Train a recipe unless it is trained already; return its run's folder.

    Raises:
        InputError: the training failed.
    """
    length = "quick" if options.quick else "published"
    folder = RUNS / f"{RECIPES[recipe]}-{data}-{length}" / str(seed)
    if (folder / "metrics.json").is_file():
        return folder
    words = [f"experiment={RECIPES[recipe]}", f"seed={seed}", "score=none"]
    words += [f"data.root={options.real}"] if data == "real" else ["data=udacity_lake"]
    words += [f"quick={str(options.quick).lower()}"]
    if recipe == "E":
        words += [f"model.weights={options.weights or 'null'}"]
    if train_logged(folder, words, options.threads):
        raise InputError(f"{folder}: the training failed; see its log.txt")
    return folder


def drive_missing(folder: Path, recipe: str, jobs: int) -> dict[Drive, dict]:
    """Drive a run's checkpoint where no figures are kept; return the figures of all its drives."""
    from zoo.base.bounded_files import read_json

    paths = {drive: folder / "claims" / f"{drive.name}.json" for drive in drives_of(recipe)}
    missing = [drive for drive, path in paths.items() if not path.is_file()]
    checkpoint = folder / "checkpoints" / "best.ckpt"
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        list(pool.map(drive_and_keep, repeat(checkpoint), missing, map(paths.get, missing)))
    return {drive: read_json(path) for drive, path in paths.items()}


def drive_and_keep(checkpoint: Path, drive: Drive, path: Path) -> None:
    """Drive a lap, and write its figures to a file."""
    from zoo.base.whole_file import json_text, write_whole

    figures = drive_once(checkpoint, drive)
    path.parent.mkdir(exist_ok=True)
    write_whole(path, json_text(figures))
    print(f"{path}: {figures}", flush=True)


class StalledError(Exception):
    """The end of a drive whose throttle does not move the car; `args[0]` is the distance in m."""


def drive_once(checkpoint: Path, drive: Drive) -> dict:
    """Drive a lap from the track's first point, and return its figures.

    A drive ends where a throttle cannot move the car: putting it back at 0 mph would not help.
    """
    import torch

    from simulator.world import open_world
    from zoo.checkpoints.policy import load_policy
    from zoo.drives.drive_log import summarize
    from zoo.drives.speed_controller import PI, Constant
    from zoo.evaluate.embedded_drive import drive_closed_loop

    torch.set_num_threads(1)  # one frame is too little work for two threads
    *_, value = drive.control.removesuffix(" mph").split()
    controls = {
        "hold": lambda: PI(float(value), kp=0.1, ki=0.002),
        "proportional": lambda: PI(float(value), kp=0.5),
        "throttle": lambda: Constant(float(value)),
    }
    speed = controls[drive.control.split()[0]]()
    world = open_world(drive.track, frame_rate=drive.frame_rate)
    moved_s = 0.0

    def check(_: object, row: DriveRow) -> None:
        nonlocal moved_s
        if row.speed_mph > 1:
            moved_s = row.time_s
        elif row.time_s - moved_s > STALLED_S:
            raise StalledError(world.travelled)

    try:
        lap = drive_closed_loop(load_policy(checkpoint), world, speed, 0, laps=1.0, show=check)
        return summarize(lap) | {STALLED: ""}
    except StalledError as stalled:
        return dict.fromkeys(FIGURES, "") | {STALLED: round(stalled.args[0])}
    finally:
        world.pictures.close()


def make_rows(options: ClaimOptions) -> list[dict]:
    """Train and drive what is missing; return a line for each drive."""
    sources = ["expert", *(["real"] if options.real else [])]
    rows = []
    for recipe in RECIPES:
        if options.only and recipe not in options.only:
            continue
        for data in sources:
            for seed in range(1, options.seeds + 1):
                folder = train(recipe, data, seed, options)
                for drive, figures in drive_missing(folder, recipe, options.threads).items():
                    rows.append(
                        {
                            "recipe": recipe,
                            "experiment": RECIPES[recipe],
                            "data": data,
                            "training": "quick" if options.quick else "published",
                            "weights": "imagenet" if recipe == "E" and options.weights else "",
                            "seed": seed,
                            "track": drive.track,
                            "control": drive.control,
                            "frame_rate": drive.frame_rate,
                            **{key: _rounded(figures[key]) for key in (*FIGURES, STALLED)},
                        }
                    )
    return rows


def _rounded(value: float | str) -> float | str:
    return value if value == "" else round(float(value), 4)


def merge(rows: list[dict]) -> list[dict]:
    """Return the kept lines of `docs/claims.csv` with new ones in place of their older versions."""

    def key(row: dict) -> tuple[str, ...]:
        names = ("recipe", "data", "training", "weights", "seed", "track", "control", "frame_rate")
        return tuple(str(row[name]) for name in names)

    kept = {key(row): row for row in read_csv()} if CSV.is_file() else {}
    kept |= {key(row): row for row in rows}
    return [kept[name] for name in sorted(kept)]


def read_csv() -> list[dict]:
    """Return the lines of `docs/claims.csv`, all as text."""
    with CSV.open(newline="") as file:
        return list(csv.DictReader(file))


def main(arguments: list[str]) -> None:
    """Make the runs, then write the file and the page.

    Raises:
        InputError: an option is wrong, or a training failed.
    """
    options = read_options(ClaimOptions, arguments)
    if options.runs:
        write_table(CSV, merge(make_rows(options)))
    print(", ".join(map(str, [CSV, *write_page(read_csv())])))


if __name__ == "__main__":
    from zoo.cli.run_command import run_command

    sys.exit(run_command("claims", main, sys.argv[1:]))
