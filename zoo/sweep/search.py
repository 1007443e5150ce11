"""Optuna chooses the values: a study in SQLite, which several processes and machines can share."""

import contextlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import IntervalSweep, Override, RangeSweep
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.errors import InputError
from zoo.drives.driving_score import driving_score
from zoo.leaderboard.ranking import Run, read_run
from zoo.leaderboard.ranking_table import folder_label
from zoo.runs.status import read_status
from zoo.sweep.grid import launch_jobs, recordings_of
from zoo.sweep.job_watch import watched
from zoo.sweep.launch_rounds import Job, launch_all
from zoo.sweep.sweep_job import SERIAL
from zoo.sweep.sweep_record import add_to_record

if TYPE_CHECKING:
    import optuna

ATTEMPTS = 5
PRUNING = "callbacks.pruning"


@dataclass(frozen=True)
class SearchSettings:
    """What `hydra.sweeper` holds with `hydra/sweeper=optuna`.

    Args:
        n_trials: of the study in all, whoever runs them.
        at_once: so many trials are chosen together and handed to the launcher.
        monitor: what is sought, and what trials are given up by: `drive/score`, autonomy with ties
            broken by cross-track error (see `zoo.drives.driving_score`), or `drive/autonomy` (the
            most), `drive/cte_mean` or `val/mse` (the least).
        storage: the study's database; processes that name the same one share the study.
        study: its name in there.
        sampler: tpe, random or gp of Optuna.
        seed: of the sampler; null for any, as several processes on one study need.
        pruner: median, halving or none: gives a trial up that is worse than the others were.
        startup_trials: are never given up.
        warmup_epochs: no trial is given up before.
    """

    n_trials: int = 20
    at_once: int = 1
    monitor: str = "drive/score"
    storage: str = "sqlite:///study.db"
    study: str = "drivezoo"
    sampler: str = "tpe"
    seed: int | None = None
    pruner: str = "median"
    startup_trials: int = 4
    warmup_epochs: int = 2


def sweep_search(
    arguments: list[str],
    settings: SearchSettings,
    config: DictConfig,
    context: HydraContext,
    launcher: Launcher,
) -> None:
    """Run trials until the study has as many as wanted; first those that a killed process left.

    Raises:
        InputError: settings that can't be, a study of other values, or a launcher that can't start.
    """
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    folder = Path(config.hydra.sweep.dir)
    parser = OverridesParser.create(config_loader=context.config_loader)
    # Of a key that is given twice the last counts, as everywhere in Hydra.
    given = {one.get_key_element(): one for one in parser.parse_overrides(arguments)}
    fixed = [
        f"{key}={one.get_value_element_as_str()}"
        for key, one in given.items()
        if not one.is_sweep_override()
    ]
    space = {key: _distribution(one) for key, one in given.items() if one.is_sweep_override()}
    if not space:
        raise InputError("nothing to search: give a key several values, or interval(1e-4,1e-2)")
    _check_monitor(settings.monitor, fixed, config, context)
    study = _open_study(settings)
    _check_space(study, space, settings)
    _check_sought(study, settings)
    add_to_record(folder, search=True, data=recordings_of([fixed], config, context))
    console = Console(soft_wrap=True)
    console.print(f"sweep: {folder_label(folder, Path.cwd())}", highlight=False, markup=False)
    serial = config.hydra.runtime.choices["hydra/launcher"] == SERIAL
    ours = [one for one in study.get_trials() if one.user_attrs.get("folder") == str(folder)]
    left = [one.number for one in ours if one.state == optuna.trial.TrialState.RUNNING]
    numbers = left or _ask(study, space, settings, folder)
    while numbers:
        jobs = [_job(study, number, fixed, settings, folder) for number in numbers]
        # What the first composes, all do: only values differ.
        for job in jobs:
            recordings_of([job.overrides], config, context, _pruning(job.number, settings))
        with contextlib.nullcontext() if serial else watched(jobs, console):
            launch_all(lambda some: launch_jobs(launcher, some), jobs, console)
        for job in jobs:
            _tell(study, job, settings.monitor)
        _say(study, settings, console)
        numbers = _ask(study, space, settings, folder)
    own = [one for one in study.get_trials() if one.user_attrs.get("folder") == str(folder)]
    add_to_record(
        folder,
        jobs=[list(_job(study, one.number, fixed, settings, folder).overrides) for one in own],
    )


def _open_study(settings: SearchSettings) -> "optuna.Study":
    import optuna

    from zoo.sweep.pruning import make_pruner

    samplers = {
        "tpe": optuna.samplers.TPESampler,
        "random": optuna.samplers.RandomSampler,
        "gp": optuna.samplers.GPSampler,
    }
    if settings.sampler not in samplers:
        raise InputError(
            f"hydra.sweeper.sampler={settings.sampler}: there are {', '.join(samplers)}"
        )
    make_pruner(settings.pruner, settings.startup_trials, settings.warmup_epochs)
    if settings.n_trials < 1 or settings.at_once < 1:
        raise InputError("hydra.sweeper: n_trials and at_once must be 1 or more")
    attempts = ATTEMPTS
    while True:
        attempts -= 1
        try:
            return optuna.create_study(
                storage=settings.storage,
                study_name=settings.study,
                direction="maximize" if _is_better_high(settings.monitor) else "minimize",
                sampler=samplers[settings.sampler](seed=settings.seed),
                load_if_exists=True,
            )
        except Exception as error:  # SQLAlchemy's, and those of the database's own driver
            # Two processes that make the same database at once get in each other's way.
            if not attempts or "(sqlite3." not in str(error):
                reason = str(error).strip().splitlines()[0]
                raise InputError(f"hydra.sweeper.storage={settings.storage}: {reason}") from None
            time.sleep(1)


def _check_space(study: "optuna.Study", space: dict, settings: SearchSettings) -> None:
    """Before a trial is made that could not be of this study."""
    from optuna.distributions import check_distribution_compatibility

    for trial in study.get_trials(deepcopy=False):
        for key in trial.distributions.keys() & space.keys():
            try:
                check_distribution_compatibility(trial.distributions[key], space[key])
            except ValueError:
                raise InputError(
                    f"{settings.storage}: the study {settings.study} has other values for {key} "
                    "than this command; name another with hydra.sweeper.study=NAME"
                ) from None


def _check_sought(study: "optuna.Study", settings: SearchSettings) -> None:
    """Values of one figure say nothing about another's."""
    earlier = study.user_attrs.get("monitor", settings.monitor)
    if earlier != settings.monitor:
        raise InputError(
            f"{settings.storage}: the study {settings.study} seeks {earlier}, not "
            f"{settings.monitor}; set hydra.sweeper.monitor={earlier}, or name another study with "
            "hydra.sweeper.study=NAME"
        )
    study.set_user_attr("monitor", settings.monitor)


def _ask(study: "optuna.Study", space: dict, settings: SearchSettings, folder: Path) -> list[int]:
    """The numbers of new trials, as many as run at once, or as are left."""
    left = settings.n_trials - len(study.get_trials(deepcopy=False))
    numbers = []
    for _ in range(min(left, settings.at_once)):
        trial = study.ask(space)
        trial.set_user_attr("folder", str(folder))
        numbers.append(trial.number)
    return numbers


def _job(
    study: "optuna.Study", number: int, fixed: Sequence[str], settings: SearchSettings, folder: Path
) -> Job:
    """A trial's values and what prunes it, as overrides."""
    values = study.get_trials()[number].params
    own = (f"{key}={value}" for key, value in values.items())
    overrides = (*fixed, *own, *_pruning(number, settings))
    return Job(number, overrides, folder / str(number))


def _pruning(number: int, settings: SearchSettings) -> list[str]:
    """Return the overrides that let a trial be given up."""
    pruning = {
        "_target_": "zoo.sweep.pruning.Pruning",
        "storage": f"'{settings.storage}'",
        "study": f"'{settings.study}'",
        "trial": number,
        "watched": settings.monitor,
        "pruner": settings.pruner,
        "startup_trials": settings.startup_trials,
        "warmup_epochs": settings.warmup_epochs,
    }
    return [f"+{PRUNING}.{key}={value}" for key, value in pruning.items()]


def _tell(study: "optuna.Study", job: Job, monitor: str) -> None:
    from optuna.trial import TrialState

    status = read_status(job.folder).get("status")
    value = _value(job.folder, monitor) if status == "finished" else None
    if value is not None:
        study.tell(job.number, value)
    else:
        study.tell(job.number, state=TrialState.PRUNED if status == "pruned" else TrialState.FAIL)


def _value(folder: Path, monitor: str) -> float | None:
    """What a run came to: of its last drive where it was driven, of its best epoch elsewhere."""
    run = read_run(folder)
    if run is None:
        return None
    scored = {
        "drive/score": _score(run),
        "drive/autonomy": run.autonomy,
        "drive/cte_mean": run.cte_m,
    }.get(monitor)
    if scored is not None:
        return scored
    by_epoch = run.curves.get(monitor, {}).values()
    return (max if _is_better_high(monitor) else min)(by_epoch, default=None)


def _score(run: Run) -> float | None:
    """The mean over the tracks that were driven; None where none was."""
    keys = ("interventions", "driven_s", "cte_mean_m")
    if not run.tracks or any(key not in one for one in run.tracks.values() for key in keys):
        return None
    scores = [driving_score(*(one[key] for key in keys)) for one in run.tracks.values()]
    return sum(scores) / len(scores)


def _say(study: "optuna.Study", settings: SearchSettings, console: Console) -> None:
    states = [one.state.name for one in study.get_trials(deepcopy=False)]
    counted = ", ".join(f"{states.count(one)} {one.lower()}" for one in dict.fromkeys(states))
    best = ""
    if "COMPLETE" in states:
        values = " ".join(f"{key}={value}" for key, value in study.best_params.items())
        best = f"; best {settings.monitor} {study.best_value:.4g} with {values}"
    console.print(
        f"study: {len(states)} of {settings.n_trials} trials, {counted}{best}",
        highlight=False,
        markup=False,
    )


def _distribution(override: Override) -> "optuna.distributions.BaseDistribution":
    """As Optuna knows it: `1,2` is a choice; `range(1,9)` has steps; `interval(1e-4,1e-2)` has
    none, and `tag(log,...)` draws from its logarithm."""
    from optuna.distributions import (
        CategoricalDistribution,
        FloatDistribution,
        IntDistribution,
    )

    value, key = override.value(), override.get_key_element()
    log = "log" in getattr(value, "tags", ())
    try:
        if isinstance(value, IntervalSweep):
            whole = isinstance(value.start, int) and isinstance(value.end, int)
            kind = IntDistribution if whole else FloatDistribution
            return kind(value.start, value.end, log=log)
        if isinstance(value, RangeSweep) and isinstance(value.step, int):
            last = value.stop - 1  # as Python's, it stops before
            return IntDistribution(value.start, last, step=1 if log else value.step, log=log)
        return CategoricalDistribution([str(one) for one in override.sweep_string_iterator()])
    except (TypeError, ValueError) as error:
        raise InputError(f"{key}: {error}") from None


def _check_monitor(
    monitor: str, fixed: Sequence[str], config: DictConfig, context: HydraContext
) -> None:
    known = ("drive/score", "drive/autonomy", "drive/cte_mean", "val/mse")
    if monitor not in known:
        raise InputError(f"hydra.sweeper.monitor={monitor}: there are {', '.join(known)}")
    job = context.config_loader.load_sweep_config(config, list(fixed))
    if monitor.startswith("drive/") and not OmegaConf.select(job, "callbacks.closed_loop"):
        raise InputError(
            f"hydra.sweeper.monitor={monitor}, but nothing drives while training; add "
            "callbacks=closed_loop, or hydra.sweeper.monitor=val/mse"
        )


def _is_better_high(monitor: str) -> bool:
    return monitor in ("drive/score", "drive/autonomy")
