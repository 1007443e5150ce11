"""Measure the time to the first training step: `python benchmarks/start.py`."""

import shutil
import subprocess
import sys
import time

from material import CACHE, linked_recording
from timing import Row, median_ratio, medians, run_part, take_turns

RUN = "outputs/bench/start"
IMPORTS = "import torch, lightning"
# Ends the process just before the first step.
FIRST_STEP = "+callbacks.first._target_=benchmarks.first_step.EndAtFirstStep"


def measure(short: bool) -> list[Row]:
    """Return the start-up time of `python -m zoo`, with cached views, relative to its imports."""
    folder = linked_recording(200 if short else 3_000)
    zoo = ["-m", "zoo", f"data.root={folder}", f"data.cache={CACHE}", "trainer.accelerator=cpu"]
    zoo += ["score=none", FIRST_STEP, f"hydra.run.dir={RUN}"]
    start(zoo)  # fills the cache of views
    found = take_turns(
        {"zoo s": lambda: start(zoo), "imports s": lambda: run_python(["-c", IMPORTS])},
        1 if short else 2,
    )
    what = "python -m zoo to its first step, views cached"
    return [Row(what, IMPORTS, median_ratio(*found.values()), 1.5, False, medians(found))]


def start(zoo: list[str]) -> float:
    """Return the seconds of a new run, after deleting the last one's folder."""
    shutil.rmtree(RUN, ignore_errors=True)
    return run_python(zoo)


def run_python(arguments: list[str]) -> float:
    """Return the seconds of a Python process."""
    began = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began


if __name__ == "__main__":
    run_part(measure)
