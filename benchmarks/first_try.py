"""Compare candidates for a first training: `python benchmarks/first_try.py [real=FOLDER]`.

It records laps of the embedded lake by a simulated student with mouse and with keyboard, forward
only and without recoveries. It trains each candidate on each recording, one at a time, and on a
recording of the original simulator if `real` names one. Then the best and the last checkpoint drive
a lap of the lake at 15 mph, the score of a run. Finished runs are not repeated.
"""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from simulator.command_line import read_options
from simulator.human_control import REACTION_S
from zoo.base.errors import InputError

AUGMENTED = "augment=[brightness,shadow,shift]"
BEFORE = "quick_samples=3200"  # an earlier quick=true
CANDIDATES = {
    "first_try": ("experiment=first_try",),
    "lenet": ("experiment=lenet", "quick=true"),
    "lenet, 3,200": ("experiment=lenet", "quick=true", BEFORE),
    "pilotnet": ("experiment=pilotnet", "quick=true"),
    "pilotnet, augmented": ("experiment=pilotnet", "quick=true", AUGMENTED),
    "pilotnet, 3,200": ("experiment=pilotnet", "quick=true", BEFORE),
}


@dataclass(frozen=True)
class FirstTryOptions:
    """Options of the comparison.

    Args:
        out: folder of the recordings and runs.
        real: folder of a recording of the original simulator; null for none.
        only: name of one candidate; null for all.
        recording: name of one recording (mouse, keyboard or real), or all.
        seeds: number of trainings of each candidate on each recording.
        laps: number of recorded laps.
        speed: speed of the recorded laps in mph.
        threads: number of OpenMP threads of a training.
    """

    out: str = "outputs/first_try"
    real: str | None = None
    only: str | None = None
    recording: str = "all"
    seeds: int = 2
    laps: float = 2.5
    speed: float = 25.0
    threads: int = 2


@dataclass(frozen=True)
class Tried:
    """A run: wall and CPU seconds of training with score, and figures of its drives."""

    wall_s: float
    cpu_s: float
    best: dict
    last: dict
    best_epoch: int
    epochs: int


def recordings(options: FirstTryOptions) -> dict[str, str]:
    """Return the recordings' folders by name; make the missing ones.

    Raises:
        InputError: no recording has that name.
    """
    home = Path(options.out, "recordings")
    found = {name: str(home / name) for name in REACTION_S}
    if options.recording not in ("all", "real", *found):
        raise InputError(f"recording={options.recording}: must be all, real, {' or '.join(found)}")
    if options.recording == "real" and not options.real:
        raise InputError("recording=real: name its folder with real=FOLDER")
    for name, folder in found.items():
        if options.recording in ("all", name) and not Path(folder, "driving_log.csv").is_file():
            words = [f"control={name}", f"laps={options.laps}", f"speed={options.speed}", "seed=1"]
            _run(["simulator", "record", "track=lake", *words, f"out={folder}"], options.threads)
    if options.real:
        found["real"] = str(Path(options.real).resolve())
    return {k: v for k, v in found.items() if options.recording in ("all", k)}


def try_one(overrides: Sequence[str], data: str, run: Path, options: FirstTryOptions) -> Tried:
    """Return a candidate's run; make it if it is missing."""
    result = run / "tried.json"
    if result.is_file():
        return Tried(**json.loads(result.read_text()))
    words = [*overrides, f"data.root={data}", "score=lake", "score.film=false"]
    own = [f"data.cache={options.out}/cache", f"hydra.run.dir={run}"]
    wall_s, cpu_s = _run(["zoo", *words, *own], options.threads)
    metrics = json.loads((run / "metrics.json").read_text())
    best = last = metrics["drive"]["tracks"]["lake"]
    if metrics["best_epoch"] != metrics["epochs"]:
        drives = run / "last"
        checkpoint = run / "checkpoints" / "last.ckpt"
        evaluation = ["track=lake", "speed=15", "seeds=1", f"out={drives}"]
        _run(["zoo.evaluate", str(checkpoint), *evaluation], options.threads)
        last = json.loads((drives / "metrics.json").read_text())["tracks"]["lake"]
    tried = Tried(wall_s, cpu_s, best, last, metrics["best_epoch"], metrics["epochs"])
    result.write_text(json.dumps(vars(tried)))
    return tried


def _run(words: list[str], threads: int) -> tuple[float, float]:
    """Run `python -m words`; return its wall and CPU seconds.

    Raises:
        InputError: the command failed.
    """
    environment = os.environ | {"OMP_NUM_THREADS": str(threads)}
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", *words], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise InputError(f"python -m {' '.join(words)}: {done.stderr.strip()[-300:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began, cpu_s


def main(arguments: Sequence[str]) -> None:
    """Make the runs; print a line after each run, and the table at the end.

    Raises:
        InputError: an option is wrong, or a command failed.
    """
    options = read_options(FirstTryOptions, arguments)
    if options.only not in (None, *CANDIDATES):
        raise InputError(
            f"only={options.only}: no such candidate; available: {'; '.join(CANDIDATES)}"
        )
    table = Table("recording", "candidate", "seed", "wall, CPU s", "best", "last", "of epochs")
    for candidate, overrides in CANDIDATES.items():
        if options.only not in (None, candidate):
            continue
        for name, folder in recordings(options).items():
            for seed in range(1, options.seeds + 1):
                run = Path(options.out, name, candidate.replace(", ", "-"), str(seed)).absolute()
                tried = try_one((*overrides, f"seed={seed}"), folder, run, options)
                row = (
                    name,
                    candidate,
                    str(seed),
                    f"{tried.wall_s:.0f}, {tried.cpu_s:.0f}",
                    _driven(tried.best),
                    _driven(tried.last),
                    f"{tried.best_epoch} of {tried.epochs}",
                )
                table.add_row(*row)
                print(" | ".join(row), flush=True)
    Console().print(table)


def _driven(score: dict) -> str:
    return f"{score['autonomy'][0]:.1%}, {score['interventions'][0]:g}"


if __name__ == "__main__":
    from zoo.cli.run_command import run_command

    sys.exit(run_command("first_try", main, sys.argv[1:]))
