"""`drivezoo sweep [key=value ...]`: resume a sweep that was stopped, and rank its jobs.

  drivezoo sweep resume=outputs/sweeps/DATE/TIME
  drivezoo train -m model=lenet,tiny seed=1,2,3 data.root=FOLDER   starts a new sweep

Also takes Hydra's keys: hydra/launcher=NAME chooses another launcher (basic, joblib, slurm, ray),
hydra.launcher.KEY=VALUE changes its settings (conf/hydra/launcher/NAME.yaml), and
hydra.sweeper.n_trials=20 sets the number of trials of a search.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from zoo.base.errors import UsageError
from zoo.cli.command import Command
from zoo.cli.run_command import run_command
from zoo.runs.saved_config import TRUST

COMMAND = Command(__doc__)


@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """Options of a resumed sweep; `conf/sweep.yaml` has their meanings and defaults."""

    resume: str | None
    trust: str


def resume_sweep(arguments: list[str]) -> None:
    """Resume the sweep in a folder.

    Skip finished jobs, run failed jobs again, and resume a stopped job from its last checkpoint.

    Raises:
        UsageError: see `zoo.sweep.start_sweep.go_on`.
    """
    _, given = COMMAND.split(arguments)
    own, more = COMMAND.without_config_keys(given)
    from zoo.cli.command_config import read_options

    options = read_options(COMMAND.name, SweepOptions, own)
    if options.resume is None:
        raise UsageError("resume: not given; name the sweep's folder with resume=FOLDER")
    from zoo.sweep.start_sweep import go_on

    trust = [f"{TRUST}={options.trust}"] if options.trust else []
    go_on(Path(options.resume), [*more, *trust])


if __name__ == "__main__":
    sys.exit(run_command("zoo.sweep", resume_sweep, sys.argv[1:]))
