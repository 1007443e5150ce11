"""Measure how networks drive: `python benchmarks/results.py [only=lenet] [seeds=3] [jobs=2]`.

It trains each recipe of `benchmarks/recipes.py` with several seeds, on recordings of the embedded
lake only. Each network drives a lap of the lake and of the mountain, which no training uses, at 15
mph. The script writes `docs/results.csv`, one run per line, and from it the tables of
`docs/recipes.md` and the networks' pages, each between two markers; `runs=false` writes the tables
alone. Runs are kept in `outputs/results`. A finished run is not repeated, so that
an interrupted command resumes.
"""

import csv
import json
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from omegaconf import OmegaConf
from rich.console import Console

from benchmarks.csv_table import write_table
from benchmarks.recipes import Recipe, recipes
from benchmarks.recoveries import FILE, MEASURED, measure_missing
from benchmarks.result_tables import write_tables
from simulator.command_line import read_options
from zoo.base.cores import usable_cores
from zoo.base.errors import InputError

RUNS, CSV = Path("outputs/results"), Path("docs/results.csv")
SCORE = (
    "score.track=[lake,mountain]",
    "score.candidate_laps=0",
    "score.laps=1",
    "score.speed=15",
    "score.film=false",
)
OPEN_LOOP = ("mse", "mae", "balanced_mae", "bias")
DRIVEN = ("autonomy", "interventions", "cte_mean_m", "cte_max_m", "latency_ms")


@dataclass(frozen=True)
class ResultOptions:
    """Options of the runs.

    Args:
        only: part of the names of recipes; null for all.
        seeds: largest number of seeds of a recipe.
        jobs: number of parallel trainings, which share the cores.
        runs: whether to make runs; false writes the tables of `docs/results.csv` alone.
        table: whether to write the CSV file and the tables.
    """

    only: str | None = None
    seeds: int = 3
    jobs: int = 2
    runs: bool = True
    table: bool = True


def run_all(chosen: list[tuple[Recipe, int]], jobs: int) -> None:
    """Make the missing runs."""
    threads = max(1, usable_cores() // jobs)

    def run(recipe: Recipe, seed: int) -> None:
        folder = run_folder(recipe, seed)
        if (folder / "metrics.json").is_file():
            return
        code = train_logged(folder, [*recipe.overrides, f"seed={seed}", *SCORE], threads)
        last = (folder / "log.txt").read_text().strip().splitlines()[-1:]
        result = "finished" if not code else f"failed: {' '.join(last)}"
        print(f"{folder}: {result}", flush=True)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(lambda job: run(*job), chosen))


def train_logged(folder: Path, words: list[str], threads: int) -> int:
    """Train in a folder, or resume there, with the output in `log.txt`; return the exit status."""
    words = [*words, f"hydra.run.dir={folder}"]
    if (folder / ".hydra" / "config.yaml").is_file():
        words = [f"resume={folder}"]
    return run_logged(folder / "log.txt", ["zoo", *words], threads)


def run_logged(log: Path, words: list[str], threads: int) -> int:
    """Run `python -m WORDS` with its output in a file, and return the exit status."""
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("w") as file:
        return subprocess.run(
            [sys.executable, "-m", *words],
            stdout=file,
            stderr=subprocess.STDOUT,
            env=os.environ | {"OMP_NUM_THREADS": str(threads)},
            check=False,
        ).returncode


def run_folder(recipe: Recipe, seed: int) -> Path:
    return RUNS / recipe.name / str(seed)


def csv_row(recipe: Recipe, seed: int) -> dict:
    """Return a finished run's row of `docs/results.csv`."""
    path = run_folder(recipe, seed) / "metrics.json"
    metrics = json.loads(path.read_text())
    test, zero = metrics["open_loop"]["test"], metrics["baselines"]["test"]["always zero"]
    row = {
        "model": recipe.model,
        "setting": recipe.setting,
        "split": OmegaConf.load(path.parent / ".hydra" / "config.yaml").data.split,
        "seed": seed,
        "in_table": int(recipe.in_table),
        "parameters": metrics["parameters"],
        "epochs": metrics["epochs"],
        "train_s": round((metrics["seconds_per_epoch"] or 0) * metrics["epochs"], 1),
        "samples_per_second": round(metrics["samples_per_second"] or 0),
        **{f"test_{key}": round(test[key], 6) for key in OPEN_LOOP},
        "test_zero_mse": round(zero["mse"], 6),
    }
    for track in ("lake", "mountain"):
        driven = (metrics["drive"] or {}).get("tracks", {}).get(track)
        for key in DRIVEN:
            row[f"{track}_{key}"] = round(driven[key][0], 4) if driven else ""
    recoveries = json.loads((path.parent / FILE).read_text())
    row |= {f"recoveries_{key}": round(recoveries[key], 6) for key in MEASURED}
    return row | {"command": shlex.join(["drivezoo", "train", *recipe.overrides, f"seed={seed}"])}


def read_csv() -> list[dict]:
    """Return the lines of `docs/results.csv`, with numbers as numbers."""
    with CSV.open(newline="") as file:
        return [{key: _value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def _value(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def write_csv(rows: list[dict]) -> None:
    """Write `docs/results.csv`."""
    write_table(CSV, rows)


def main(arguments: list[str]) -> None:
    """Make the runs, then write the tables.

    Raises:
        InputError: an option is wrong, or no run has figures.
    """
    options = read_options(ResultOptions, arguments)
    if options.runs:
        make_runs(options)
    if options.table:
        print(", ".join(map(str, [CSV, *write_tables(read_csv())])))


def make_runs(options: ResultOptions) -> None:
    """Make the runs that are missing and, unless `table=false`, write `docs/results.csv`.

    Raises:
        InputError: no run has figures.
    """
    jobs = [
        (recipe, seed)
        for recipe in recipes()
        for seed in range(1, min(recipe.seeds, options.seeds) + 1)
    ]
    run_all([job for job in jobs if (options.only or "") in job[0].name], options.jobs)
    if not options.table:
        return
    done = [job for job in jobs if (run_folder(*job) / "metrics.json").is_file()]
    measure_missing([run_folder(*job) for job in done], Console(soft_wrap=True))
    rows = [csv_row(*job) for job in done]
    if not rows:
        raise InputError(f"{RUNS}: no run has a metrics.json; see each run's log.txt")
    write_csv(rows)


if __name__ == "__main__":
    from zoo.cli.run_command import run_command

    sys.exit(run_command("results", main, sys.argv[1:]))
