"""`drivezoo demo`: run the whole chain: record, train, score, report, drive, film."""

import datetime
import subprocess
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from zoo.base.child_process import child_environment, module_command
from zoo.base.command import command
from zoo.base.console_script import commands
from zoo.base.errors import InputError
from zoo.base.terminal import command_line, print_written

SPEED_MPH = 25


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
            f"speed.set_mph={SPEED_MPH}",
            f"record={drive}",
        ],
        "film it": ["film", str(drive), f"out={run / 'drive.mp4'}", "fps=30"],
    }
    table, modules = Table("stage", "seconds"), commands()
    for stage, words in stages.items():
        typed = command_line(["drivezoo", *words])
        console.print(f"\n> {typed}", highlight=False, markup=False)
        began = time.perf_counter()
        process = module_command(modules[words[0]], *words[1:])
        if subprocess.run(process, env=child_environment(), check=False).returncode:
            raise InputError(f"could not {stage}; see the error above")
        table.add_row(stage, f"{time.perf_counter() - began:.0f}")
    console.print(table)
    written: list[str | Path] = [
        best,
        run / "drive.mp4",
        run / "report" / "index.html",
        run / "metrics.json",
        run / "drives" / "lake-0" / "track.png",
        drive,
    ]
    # With score=none there are no drives.
    there = [path for path in written if Path(path).exists()]
    print_written(there, ["drive", best, "sim=lake"], console)


if __name__ == "__main__":
    demo.run()
