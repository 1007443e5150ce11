"""`python -m zoo.sweep resume=FOLDER`: finish a sweep that was stopped, and rank its jobs."""

import sys
from pathlib import Path

from datamodules.errors import InputError
from zoo.command_line import run_command

USAGE = "usage: python -m zoo.sweep resume=FOLDER [hydra/launcher=... hydra.launcher.KEY=VALUE]"


def resume_sweep(arguments: list[str]) -> None:
    """Go on with the sweep in a folder: what is finished is skipped, what failed is tried again, a
    half-trained job goes on from its last checkpoint.

    Raises:
        InputError: see `zoo.sweeping.start.go_on`.
    """
    if not arguments or {"-h", "--help"} & set(arguments):
        raise InputError(USAGE)
    named = [one for one in arguments if one.startswith("resume=")]
    if len(named) != 1:
        raise InputError(f"name one sweep's folder; {USAGE}")
    from zoo.sweeping.start import go_on

    more = [one for one in arguments if one not in named]
    go_on(Path(named[0].removeprefix("resume=")), more)


if __name__ == "__main__":
    sys.exit(run_command("zoo.sweep", resume_sweep, sys.argv[1:]))
