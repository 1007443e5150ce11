"""Measure the time to the first training step: `make bench ONLY=start`."""

import os
import shutil
import subprocess
import sys
import time

from benchmarks.material import CACHE, linked_recording
from benchmarks.measuring import Row, compared, take_turns

RUN = "outputs/bench/start"
IMPORTS = "import torch, lightning"
# Ends the process just before the first step.
FIRST_STEP = "+callbacks.first._target_=benchmarks.training_callbacks.EndAtFirstStep"
AIM = 1.25


def measure(short: bool) -> list[Row]:
    """Return the start-up time of `drivezoo train`, with cached views, relative to its imports.

    The second row counts processor time, which other programs on the machine change less.
    """
    folder = linked_recording(200 if short else 3_000)
    zoo = ["-m", "zoo", f"data.root={folder}", f"data.cache={CACHE}", "trainer.accelerator=cpu"]
    zoo += ["score=none", FIRST_STEP, f"hydra.run.dir={RUN}"]
    start(zoo)  # fills the cache of views
    seconds = take_turns(
        {"zoo": lambda: start(zoo), "imports": lambda: run_python(["-c", IMPORTS])},
        1 if short else 2,
    )
    rows = []
    first = "drivezoo train to its first step, views cached"
    for at, (what, unit) in enumerate(((first, "s"), ("the same, processor time", "processor s"))):
        times = {f"{name} {unit}": [run[at] for run in runs] for name, runs in seconds.items()}
        rows.append(compared(times, what, IMPORTS, tuple(times), AIM, False))
    return rows


def start(zoo: list[str]) -> tuple[float, float]:
    """Return the seconds of a new run, after deleting the last one's folder."""
    shutil.rmtree(RUN, ignore_errors=True)
    return run_python(zoo)


def run_python(arguments: list[str]) -> tuple[float, float]:
    """Return the seconds of a Python process, by the clock and of processor time."""
    began, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    seconds, after = time.perf_counter() - began, os.times()
    used = after.children_user + after.children_system
    return seconds, used - before.children_user - before.children_system
