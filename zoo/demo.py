"""`python -m zoo.demo`: the main job from nothing: record, train, score, report, and drive over the
socket.

Runs the commands that a person would type, and prints each before it runs.
"""

import datetime
import shlex
import subprocess
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from datamodules.errors import InputError, UsageError
from zoo.cli.arguments import is_help
from zoo.cli.run_command import run_command

SPEED_MPH = 20
HELP = """usage: python -m zoo.demo

The main job from nothing: records laps of the embedded lake, trains PilotNet on them, scores it by
driving, then serves it over the socket, drives a lap and films it. Takes no options; prints each
command before it runs."""


def demo(arguments: list[str]) -> None:
    """Every stage into one run's folder; then how long each took, and where things are.

    Raises:
        InputError: a stage failed; it has said why.
    """
    if is_help(arguments):
        print(HELP)
        return
    if arguments:
        raise UsageError("takes no arguments; python -m zoo --help has the settings")
    console = Console(soft_wrap=True)
    run = Path("outputs") / f"{datetime.datetime.now():%Y-%m-%d/%H-%M-%S}-demo"
    best = str(run / "checkpoints" / "best.ckpt")
    drive = run / "drive"
    stages = {
        "record (once), train, score by driving, report": [
            "zoo",
            "model=nvidia",
            "quick=true",
            "quick_samples=3200",  # enough of an expert's laps with recoveries
            f"hydra.run.dir={run}",
        ],
        "drive a lap over the socket": [
            "zoo.drive",
            best,
            "drive.sim=lake",
            "drive.laps=1",
            "drive.port=0",
            f"drive.speed.set_mph={SPEED_MPH}",
            f"drive.record={drive}",
        ],
        "film it": ["zoo.film", str(drive), f"out={run / 'lap.mp4'}", "fps=30"],
    }
    table = Table("stage", "seconds")
    for stage, words in stages.items():
        console.print(f"\n> python -m {shlex.join(words)}", highlight=False, markup=False)
        began = time.perf_counter()
        if subprocess.run([sys.executable, "-m", *words], check=False).returncode:
            raise InputError(f"could not {stage}; the line above says why")
        table.add_row(stage, f"{time.perf_counter() - began:.0f}")
    console.print(table)
    for name, path in {
        "checkpoint": best,
        "film of the lap": run / "lap.mp4",
        "report": run / "report" / "index.html",
        "scores": run / "metrics.json",
        "where it drove": run / "drives" / "lake-0" / "track.png",
        "the drive, as a recording": drive,
    }.items():
        if Path(path).exists():  # a run that was not driven has no drives
            console.print(f"{name}: {path}", highlight=False, markup=False)


if __name__ == "__main__":
    sys.exit(run_command("zoo.demo", demo, sys.argv[1:]))
