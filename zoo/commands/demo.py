"""`drivezoo demo`: run the whole chain: record, train, score, report, drive, film."""

import datetime
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from zoo.base.child_process import run_module
from zoo.base.command import command
from zoo.base.console_script import commands
from zoo.base.errors import InputError
from zoo.base.terminal import command_line, print_written


@command
def demo() -> None:
    """Run the whole chain: record, train, score, report, drive, film.

    Records laps of the embedded lake, trains PilotNet on them and scores it by driving. Then serves
    it on the socket, drives half a lap and films that. Prints each command before it runs.

    Raises:
        InputError: a stage failed and printed its error.
    """
    console = Console(soft_wrap=True)
    run = Path("outputs") / f"{datetime.datetime.now():%Y-%m-%d/%H-%M-%S}-demo"
    best = str(run / "checkpoints" / "best.ckpt")
    drive = run / "drive"
    stages = {
        "record (once), train, score by driving, report": [
            "train",
            "model=nvidia",
            "data=lake_quick",
            "quick=true",
            "quick_samples=3200",  # enough if an expert's laps include recoveries
            "score=fast",  # with the quality of the recording
            "score.speed=20",
            "score.film=false",  # because the drive over the socket is filmed
            f"hydra.run.dir={run}",
        ],
        "drive half a lap over the socket": [
            "drive",
            best,
            "sim=lake",
            "laps=0.5",
            "port=0",
            "speed.set_mph=25",
            f"record={drive}",
        ],
        "film it": ["film", str(drive), f"out={run / 'drive.mp4'}", "fps=30"],
    }
    table, modules = Table("stage", "seconds"), commands()
    for stage, words in stages.items():
        console.print(f"\n> {command_line(['drivezoo', *words])}", highlight=False, markup=False)
        began = time.perf_counter()
        if run_module(modules[words[0]], *words[1:], env={}):
            raise InputError(f"could not {stage}; see the error above")
        table.add_row(stage, f"{time.perf_counter() - began:.0f}")
    console.print(table)
    names = ("drive.mp4", "report/index.html", "metrics.json", "drives/lake-0/track.png", "drive")
    there: list[str | Path] = [best]
    there += [run / name for name in names if (run / name).exists()]
    print_written(there, ["drive", best, "sim=lake"], console)


if __name__ == "__main__":
    demo.run()
