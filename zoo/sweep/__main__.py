"""`python -m zoo.sweep [key=value ...]`: finish a sweep that was stopped, and rank its jobs.

  python -m zoo.sweep resume=outputs/sweeps/DATE/TIME
  python -m zoo -m model=lenet,tiny seed=1,2,3 data.root=FOLDER   begins a new sweep

Hydra's own keys say how it is finished: hydra/launcher=NAME by another launcher (basic, joblib,
slurm, ray; conf/hydra/launcher/NAME.yaml has the settings, hydra.launcher.KEY=VALUE), and
hydra.sweeper.n_trials=20 so many trials of a search.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from datamodules.errors import UsageError
from zoo.cli.command import Command
from zoo.cli.run_command import run_command
from zoo.runs.saved_config import TRUST

COMMAND = Command(__doc__)


@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """The options of a resumed sweep; `conf/sweep.yaml` has their meanings and defaults."""

    resume: str | None
    trust: str


def resume_sweep(arguments: list[str]) -> None:
    """Resume the sweep in a folder: finished jobs are skipped, failed ones are tried again, a
    half-trained one is resumed from its last checkpoint.

    Raises:
        UsageError: see `zoo.sweep.start_sweep.go_on`.
    """
    _, given = COMMAND.split(arguments)
    own, more = COMMAND.without_config_keys(given)
    from zoo.cli.command_config import read_options

    options = read_options(COMMAND.name, SweepOptions, own)
    if options.resume is None:
        raise UsageError("resume: is missing; name the sweep's folder, resume=FOLDER")
    from zoo.sweep.start_sweep import go_on

    trust = [f"{TRUST}={options.trust}"] if options.trust else []
    go_on(Path(options.resume), [*more, *trust])


if __name__ == "__main__":
    sys.exit(run_command("zoo.sweep", resume_sweep, sys.argv[1:]))
