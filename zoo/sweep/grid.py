"""Sweeps over all combinations of values; each combination is a job with its own folder."""

import contextlib
from collections.abc import Sequence
from pathlib import Path

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from zoo.base.errors import InputError
from zoo.leaderboard.ranking_table import folder_label
from zoo.sweep.jobs import Job, launch_all, watched
from zoo.sweep.saved_sweep import check_job
from zoo.sweep.sweep_job import SERIAL
from zoo.sweep.sweep_record import add_to_record, log_digest


def sweep_grid(
    arguments: list[str], config: DictConfig, context: HydraContext, launcher: Launcher
) -> None:
    """Run every combination that is not done yet.

    Raises:
        HydraException, OmegaConfBaseException: a job's config is invalid; no job has run.
        InputError: an override is an interval, or the launcher cannot start a job.
    """
    folder = Path(config.hydra.sweep.dir)
    parsed = OverridesParser.create(config_loader=context.config_loader).parse_overrides(arguments)
    for override in parsed:
        if override.is_sweep_override() and not override.is_discrete_sweep():
            raise InputError(
                f"{override.get_key_element()}: a grid needs a list of values, not an interval; "
                "list values, or let Optuna choose them with hydra/sweeper=optuna"
            )
    (combinations,) = BasicSweeper.split_arguments(parsed, None)
    jobs = [
        Job(number, tuple(overrides), folder / str(number))
        for number, overrides in enumerate(combinations)
    ]
    data = recordings_of([job.overrides for job in jobs], config, context)
    add_to_record(folder, jobs=[list(job.overrides) for job in jobs], data=data)
    run_jobs(jobs, config, launcher, sweep_console(folder))


def sweep_console(folder: Path) -> Console:
    """Return the console of a sweep, on which its folder is printed."""
    console = Console(soft_wrap=True)
    console.print(f"sweep: {folder_label(folder, Path.cwd())}", highlight=False, markup=False)
    return console


def run_jobs(jobs: Sequence[Job], config: DictConfig, launcher: Launcher, console: Console) -> None:
    """Run jobs by one of Hydra's launchers; each job's folder is its number."""

    def launch(some: Sequence[Job]) -> None:
        overrides = [[*job.overrides, f"hydra.sweep.subdir='{job.number}'"] for job in some]
        launcher.launch(overrides, initial_job_idx=some[0].number)

    serial = config.hydra.runtime.choices["hydra/launcher"] == SERIAL
    # Jobs that run one by one print their own progress.
    with contextlib.nullcontext() if serial else watched(jobs, console):
        launch_all(launch, jobs, console)


def recordings_of(
    jobs: Sequence[Sequence[str]],
    config: DictConfig,
    context: HydraContext,
    added: Sequence[str] = (),
) -> dict[str, str | None]:
    """Compose every job, to report mistakes before the first job starts.

    Args:
        jobs: overrides of each job.
        config: config of the sweep.
        context: Hydra's loaders.
        added: overrides that a search added, see `check_job`.

    Returns:
        By folder of each recording that the jobs read, the digest of its log.
    """
    roots: list[str] = []
    for overrides in jobs:
        job = context.config_loader.load_sweep_config(config, list(overrides))
        check_job(overrides, job, added)
        root = job.data.get("root")
        if root is None:
            root = OmegaConf.select(job, "data.record.out")
        found = list(root) if OmegaConf.is_list(root) else [root]
        roots += [str(path) for path in found if path is not None]
    return {root: log_digest(root) for root in dict.fromkeys(roots)}
