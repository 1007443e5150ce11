"""`python -m zoo.sweep resume=FOLDER`: finish a sweep that was stopped, and rank its jobs."""

import sys
from pathlib import Path

from datamodules.errors import UsageError
from zoo.cli.arguments import is_help
from zoo.cli.run_command import run_command

USAGE = "usage: python -m zoo.sweep resume=FOLDER [hydra/launcher=NAME hydra.launcher.KEY=VALUE...]"
HELP = f"""{USAGE}

Finishes a sweep that was stopped, as the command that began it would, and ranks its jobs.

  resume=FOLDER              the sweep's folder, outputs/sweeps/DATE/TIME
  hydra/launcher=NAME        finish it by another: basic (one by one), joblib, slurm, ray
  hydra.launcher.KEY=VALUE   a setting of that; conf/hydra/launcher/NAME.yaml has them
  hydra.sweeper.n_trials=20  of a search: so many trials in all
  trust=my.module.Class      classes and keys that its jobs may name beside the package's own

A new sweep: python -m zoo -m model=lenet,tiny seed=1,2,3 data.root=FOLDER"""


def resume_sweep(arguments: list[str]) -> None:
    """Go on with the sweep in a folder: what is finished is skipped, what failed is tried again, a
    half-trained job goes on from its last checkpoint.

    Raises:
        UsageError: see `zoo.sweep.start_sweep.go_on`.
    """
    if is_help(arguments):
        print(HELP)
        return
    if not arguments:
        raise UsageError(f"{USAGE}; --help explains")
    named = [one for one in arguments if one.startswith("resume=")]
    if len(named) != 1:
        raise UsageError(f"name one sweep's folder; {USAGE}")
    from zoo.sweep.start_sweep import go_on

    more = [one for one in arguments if one not in named]
    go_on(Path(named[0].removeprefix("resume=")), more)


if __name__ == "__main__":
    sys.exit(run_command("zoo.sweep", resume_sweep, sys.argv[1:]))
