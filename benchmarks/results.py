"""`python benchmarks/results.py [only=lenet] [seeds=3] [jobs=2]`: how every network drives.

Trains each recipe below on recordings of the embedded lake alone, several seeds each, and drives a
lap of the lake and of the mountain, which no recipe has seen, at 15 mph. Writes `docs/results.csv`,
a run a line, and the table in the README between its two markers. Runs are kept in
`outputs/results`, and a finished one is not repeated: a command that was stopped goes on.
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

import numpy as np
from omegaconf import OmegaConf

from datamodules.errors import InputError
from simulator.command_line import read_options
from simulator.errors import SimulatorError

RUNS, CSV = Path("outputs/results"), Path("docs/results.csv")
README, BEGIN, END = Path("README.md"), "<!-- results -->", "<!-- end of results -->"
SCORE = ("score.track=[lake,mountain]", "score.laps=1", "score.speed=15", "score.film=false")
OPEN_LOOP = ("mse", "mae", "balanced_mae", "bias")
DRIVEN = ("autonomy", "interventions", "cte_mean_m", "cte_max_m", "latency_ms")


@dataclass(frozen=True)
class Recipe:
    """A row of the table: a network, and the settings that it is trained with.

    Attributes:
        model: of the zoo.
        setting: `published`, or what was changed.
        overrides: of `python -m zoo`.
        seeds: trained at most so often.
        in_table: False for those that only the offline metrics are compared on.
    """

    model: str
    setting: str
    overrides: tuple[str, ...]
    seeds: int = 3
    in_table: bool = True

    @property
    def name(self) -> str:
        return f"{self.model}-{self.setting.replace(',', '').replace(' ', '_')}"


@dataclass(frozen=True)
class ResultOptions:
    """Which runs to make, and how many at a time.

    Args:
        only: a part of the names of recipes; null for all.
        seeds: at most so many each.
        jobs: trainings at a time, which share the cores.
        table: false to make the runs alone.
    """

    only: str | None = None
    seeds: int = 3
    jobs: int = 2
    table: bool = True


def recipes() -> list[Recipe]:
    """The rows of the table, then variations of cheap networks: worse and better ones, which tell
    whether a metric can tell them apart."""
    short = ("data.samples_per_epoch=1600", "trainer.max_epochs=3", "optim.lr=0.0003")
    larger = ("model.size=[2,16]", "data.crop=[55,40]", "data.offset=0.35")
    cropped = (
        "data.crop=[50,20]",
        "augment=[brightness,bend]",
        "data.samples_per_epoch=4800",
        "trainer.max_epochs=4",
        "schedule=cosine",
    )
    best = ("data.samples_per_epoch=6400", "trainer.max_epochs=6", "schedule=cosine")
    rows = [
        Recipe(model, setting, overrides, seeds)
        for model, setting, overrides, seeds in (
            ("lenet", "published", ("experiment=lenet",), 3),
            ("lenet", "with bends", ("experiment=lenet", "augment=[brightness,bend]"), 3),
            ("nvidia", "published, quick", ("experiment=pilotnet", "quick=true"), 3),
            ("nvidia", "with bends", ("model=nvidia", *best, "augment=[brightness,bend]"), 3),
            ("commaai", "published, quick", ("experiment=commaai", "quick=true"), 3),
            ("commaai", "with bends, cropped", ("model=commaai", *cropped), 3),
            ("tiny", "published", ("experiment=tiny41",), 3),
            ("tiny63", "published", ("experiment=tiny63",), 3),
            ("vgg", "without ImageNet", ("experiment=vgg", "model.weights=null", *short), 1),
            ("linear", "ours, 15 numbers", ("experiment=linear15",), 3),
            ("linear", "ours, 33 numbers", ("experiment=linear15", *larger), 3),
        )
    ]
    bases = {
        "lenet": ("model=lenet", "quick=true"),
        "tiny": ("experiment=tiny41", "trainer.max_epochs=10"),
        "nvidia": ("model=nvidia", "quick=true"),
    }
    changes = {
        "plain": (),
        "centre camera": ("data.cameras=[center]",),
        "small offset": ("data.offset=0.1",),
        "large offset": ("data.offset=0.5",),
        "bends": ("augment=[brightness,bend]",),
        "one epoch": ("trainer.max_epochs=1",),
    }
    varied = [
        Recipe(model, f"{setting}, {split}", (*base, f"data.split={split}", *more), 1, False)
        for model, base in bases.items()
        for split in ("blocks", "random")
        for setting, more in changes.items()
    ]
    return rows + varied


def run_all(chosen: list[tuple[Recipe, int]], jobs: int) -> None:
    """Make the runs that are not there yet."""
    threads = max(1, (os.cpu_count() or 1) // jobs)
    # Spinning threads would take the cores from the other trainings.
    environment = os.environ | {"OMP_NUM_THREADS": str(threads), "OMP_WAIT_POLICY": "passive"}

    def run(recipe: Recipe, seed: int) -> None:
        folder = run_folder(recipe, seed)
        if (folder / "metrics.json").is_file():
            return
        words = [*recipe.overrides, f"seed={seed}", *SCORE, f"hydra.run.dir={folder}"]
        if (folder / "checkpoints" / "last.ckpt").is_file():
            words = [f"resume={folder}"]
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "log.txt").open("w") as log:
            code = subprocess.run(
                [sys.executable, "-m", "zoo", *words],
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                check=False,
            ).returncode
        last = (folder / "log.txt").read_text().strip().splitlines()[-1:]
        said = "finished" if not code else f"failed: {' '.join(last)}"
        print(f"{folder}: {said}", flush=True)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(lambda job: run(*job), chosen))


def run_folder(recipe: Recipe, seed: int) -> Path:
    return RUNS / recipe.name / str(seed)


def csv_row(recipe: Recipe, seed: int) -> dict | None:
    """A run as a line of `docs/results.csv`; None for one that has no figures."""
    path = run_folder(recipe, seed) / "metrics.json"
    if not path.is_file():
        return None
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
    return row | {"command": shlex.join(["python", "-m", "zoo", *recipe.overrides, f"seed={seed}"])}


def markdown_table(rows: list[dict]) -> str:
    """A line a recipe, in their order: means over its seeds, and the worst of them."""
    lines = [
        "| model | setting | parameters | seeds | training | test MSE (zero) "
        "| lake: autonomy (worst) | mean, max error | mountain: autonomy (worst) | latency |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    groups: dict[tuple[str, str], list[dict]] = {}
    for row in rows:
        if row["in_table"] and row["lake_autonomy"] != "":
            groups.setdefault((row["model"], row["setting"]), []).append(row)
    for (model, setting), group in groups.items():
        mean = {
            key: float(np.mean([one[key] for one in group]))
            for key, value in group[0].items()
            if not isinstance(value, str)
        }
        worst = {
            track: min(one[f"{track}_autonomy"] for one in group) for track in ("lake", "mountain")
        }
        cells = [
            model,
            setting,
            f"{group[0]['parameters']:,}",
            str(len(group)),
            _duration(mean["train_s"]),
            f"{mean['test_mse']:.4f} ({mean['test_zero_mse']:.4f})",
            f"{mean['lake_autonomy']:.1%} ({worst['lake']:.1%})",
            f"{mean['lake_cte_mean_m']:.2f}, {max(one['lake_cte_max_m'] for one in group):.2f} m",
            f"{mean['mountain_autonomy']:.1%} ({worst['mountain']:.1%})",
            f"{mean['lake_latency_ms']:.1f} ms",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _duration(seconds: float) -> str:
    if not seconds:  # a run that was stopped and resumed when all was trained
        return "-"
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def write_results(rows: list[dict]) -> None:
    """`docs/results.csv` and the README's table."""
    CSV.parent.mkdir(exist_ok=True)
    with CSV.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    text = README.read_text()
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    README.write_text(f"{before}{BEGIN}\n{markdown_table(rows)}\n{END}{after}")
    print(f"{CSV}, {README}")


def main(arguments: list[str]) -> None:
    """Make the runs, then the files.

    Raises:
        InputError: an option that is none, or no run has figures.
    """
    try:
        options = read_options(ResultOptions, arguments)
    except SimulatorError as error:
        raise InputError(str(error)) from None
    jobs = [
        (recipe, seed)
        for recipe in recipes()
        for seed in range(1, min(recipe.seeds, options.seeds) + 1)
    ]
    run_all([job for job in jobs if (options.only or "") in job[0].name], options.jobs)
    if not options.table:
        return
    rows = [row for job in jobs if (row := csv_row(*job))]
    if not rows:
        raise InputError(f"{RUNS}: no run has figures")
    write_results(rows)


if __name__ == "__main__":
    from zoo.command_line import run_command

    sys.exit(run_command("results", main, sys.argv[1:]))
