"""`drivezoo sweep`: resume a sweep that was stopped, and rank its jobs."""

from pathlib import Path

from zoo.base.command import command
from zoo.base.errors import UsageError
from zoo.runs.saved_config import TRUST


@command(config=True)
def sweep(*overrides: str, resume: str | None = None, trust: str = "") -> None:
    """Resume a sweep that was stopped, and rank its jobs.

      drivezoo sweep resume=outputs/sweeps/DATE/TIME
      drivezoo train -m model=lenet,tiny seed=1,2,3 data.root=FOLDER   starts a new sweep

    Skips finished jobs, runs failed jobs again, and resumes a stopped job from its last checkpoint.
    Also takes Hydra's keys: hydra/launcher=NAME chooses another launcher (basic, joblib, slurm,
    ray), hydra.launcher.KEY=VALUE changes its settings (conf/hydra/launcher/NAME.yaml), and
    hydra.sweeper.n_trials=20 sets the number of trials of a search.

    Args:
        *overrides: keys of the launcher and the sweeper.
        resume: folder of the sweep.
        trust: further classes and keys that its jobs may name, separated by commas.

    Raises:
        UsageError: see `zoo.training.start_sweep.go_on`.
    """
    if resume is None:
        raise UsageError("resume: not given; name the sweep's folder with resume=FOLDER")
    from zoo.base.compose import one_line_errors
    from zoo.training.start_sweep import go_on

    with one_line_errors(overrides):
        go_on(Path(resume), [*overrides, *[f"{TRUST}={trust}"] * bool(trust)])


if __name__ == "__main__":
    sweep.run()
