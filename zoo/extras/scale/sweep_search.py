"""Sweeps whose values Optuna chooses, in a study that processes and machines can share."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import optuna
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import IntervalSweep, Override, RangeSweep
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext
from omegaconf import DictConfig, OmegaConf
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
    check_distribution_compatibility,
)
from optuna.trial import TrialState

from zoo.base.errors import InputError
from zoo.base.terminal import print_line
from zoo.driving.interventions import driving_score
from zoo.extras.scale.sweep_pruning import make_pruner
from zoo.results.scored import Scored, finished_run
from zoo.runs.status import read_status
from zoo.training.sweep_jobs import Job, recordings_of, run_jobs, sweep_console
from zoo.training.sweep_record import PRUNING, add_to_record

ATTEMPTS = 5
MAXIMIZED = ("drive/score", "drive/autonomy")
MONITORS = (*MAXIMIZED, "drive/cte_mean", "val/mse")


def sweep_search(
    arguments: list[str], config: DictConfig, context: HydraContext, launcher: Launcher
) -> None:
    """Run trials until the study has `n_trials`, first those that a killed process left.

    Raises:
        InputError: invalid settings, a study with other values, or a launcher that cannot start.
    """
    folder = Path(config.hydra.sweep.dir)
    parsed = OverridesParser.create(config_loader=context.config_loader).parse_overrides(arguments)
    # If a key is given twice, the last value counts, as everywhere in Hydra.
    typed = {override.get_key_element(): override for override in parsed}
    space = {key: _distribution(typed[key]) for key in typed if typed[key].is_sweep_override()}
    fixed = [f"{key}={typed[key].get_value_element_as_str()}" for key in typed if key not in space]
    if not space:
        raise InputError(
            "no key to search over; give a key several values, or KEY=interval(1e-4,1e-2)"
        )
    _check_monitor(config.hydra.sweeper.monitor, fixed, config, context)
    search = Search(config.hydra.sweeper, fixed, space, folder)
    add_to_record(folder, search=True, jobs=None, data=recordings_of([fixed], config, context))
    console = sweep_console(folder)
    numbers = search.own_trials(running=True) or search.ask()
    if not numbers:
        print_line(console, f"{search.state()}; hydra.sweeper.n_trials= adds trials")
    while numbers:
        jobs = [search.job(number) for number in numbers]
        for job in jobs:
            recordings_of([job.overrides], config, context, search.pruning(job.number))
        run_jobs(jobs, config, launcher, console)
        for job in jobs:
            search.report(job)
        print_line(console, search.state())
        numbers = search.ask()
    trials = search.own_trials()
    add_to_record(folder, jobs=[list(search.job(number).overrides) for number in trials])


class Search:
    """The trials that one sweep adds to an Optuna study.

    Args:
        settings: settings of the sweeper, see `conf/hydra/sweeper/optuna.yaml`.
        fixed: overrides of every trial.
        space: distribution of each key that is searched.
        folder: folder of the sweep.

    Raises:
        InputError: invalid settings, or a study with other values or another figure.
    """

    def __init__(
        self, settings: DictConfig, fixed: Sequence[str], space: dict, folder: Path
    ) -> None:
        self.settings, self.fixed, self.space, self.folder = settings, fixed, space, folder
        self.study = _open_study(settings)
        study = f"{settings.storage}: the study {settings.study}"
        earlier = self.study.user_attrs.get("monitor", settings.monitor)
        if earlier != settings.monitor:
            raise InputError(
                f"{study} optimizes {earlier}, not {settings.monitor}; set "
                f"hydra.sweeper.monitor={earlier}, or name another with hydra.sweeper.study=NAME"
            )
        for trial in self.study.get_trials(deepcopy=False):
            for key in trial.distributions.keys() & space.keys():
                try:
                    check_distribution_compatibility(trial.distributions[key], space[key])
                except ValueError:
                    raise InputError(
                        f"{study} has other values for {key} than this command; name another with "
                        "hydra.sweeper.study=NAME"
                    ) from None
        self.study.set_user_attr("monitor", settings.monitor)

    def own_trials(self, running: bool = False) -> list[int]:
        """Return the numbers of this sweep's trials, of all or of those that have not ended."""
        return [
            trial.number
            for trial in self.study.get_trials(deepcopy=False)
            if trial.user_attrs.get("folder") == str(self.folder)
            and not (running and trial.state.is_finished())
        ]

    def ask(self) -> list[int]:
        """Create up to `at_once` of the remaining trials, and return their numbers."""
        left = self.settings.n_trials - len(self.study.get_trials(deepcopy=False))
        numbers = []
        for _ in range(min(left, self.settings.at_once)):
            trial = self.study.ask(self.space)
            trial.set_user_attr("folder", str(self.folder))
            numbers.append(trial.number)
        return numbers

    def job(self, number: int) -> Job:
        """Return a trial as a job: its values and its pruning callback as overrides."""
        drawn = (f"{key}={value}" for key, value in self.study.get_trials()[number].params.items())
        return Job(number, (*self.fixed, *drawn, *self.pruning(number)), self.folder / str(number))

    def pruning(self, number: int) -> list[str]:
        """Return the overrides that add the pruning callback to a trial."""
        settings = self.settings
        pruning = {
            "_target_": "zoo.extras.scale.sweep_pruning.Pruning",
            "storage": f"'{settings.storage}'",
            "study": f"'{settings.study}'",
            "trial": number,
            "watched": settings.monitor,
            **{key: settings[key] for key in ("pruner", "startup_trials", "warmup_epochs")},
        }
        return [f"+{PRUNING}.{key}={value}" for key, value in pruning.items()]

    def report(self, job: Job) -> None:
        """Pass a job's figure to the study, or that it was pruned or failed."""
        status = read_status(job.folder).get("status")
        value = _value(job.folder, self.settings.monitor) if status == "finished" else None
        ended = TrialState.PRUNED if status == "pruned" else TrialState.FAIL
        self.study.tell(job.number, value, None if value is not None else ended)

    def state(self) -> str:
        """Return how many trials ended in each way, and the best values."""
        states = [trial.state.name for trial in self.study.get_trials(deepcopy=False)]
        counted = ", ".join(f"{count} {name.lower()}" for name, count in Counter(states).items())
        best = ""
        if "COMPLETE" in states:
            values = " ".join(f"{key}={value}" for key, value in self.study.best_params.items())
            best = f"; best {self.settings.monitor} {self.study.best_value:.4g} with {values}"
        return f"study: {len(states)} of {self.settings.n_trials} trials, {counted}{best}"


def _open_study(settings: DictConfig, attempt: int = 1) -> optuna.Study:
    samplers = {
        "tpe": optuna.samplers.TPESampler,
        "random": optuna.samplers.RandomSampler,
        "gp": optuna.samplers.GPSampler,
    }
    if settings.sampler not in samplers:
        raise InputError(
            f"hydra.sweeper.sampler={settings.sampler}: must be one of {', '.join(samplers)}"
        )
    make_pruner(settings.pruner, settings.startup_trials, settings.warmup_epochs)
    if settings.n_trials < 1 or settings.at_once < 1:
        raise InputError("hydra.sweeper: n_trials and at_once must be 1 or more")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        return optuna.create_study(
            storage=settings.storage,
            study_name=settings.study,
            direction="maximize" if settings.monitor in MAXIMIZED else "minimize",
            sampler=samplers[settings.sampler](seed=settings.seed),
            load_if_exists=True,
        )
    except Exception as error:  # of SQLAlchemy or the database's driver
        if attempt == ATTEMPTS or "(sqlite3." not in str(error):
            reason = str(error).strip().splitlines()[0]
            raise InputError(f"hydra.sweeper.storage={settings.storage}: {reason}") from None
    # Two processes that create the same SQLite file at once disturb each other: try again.
    time.sleep(1)
    return _open_study(settings, attempt + 1)


def _value(folder: Path, monitor: str) -> float | None:
    """Return a run's figure: from its last drive, or else from its best epoch."""
    run = finished_run(folder)
    if run is None:
        return None
    driven = {"drive/score": _score(run), "drive/autonomy": run.mean("autonomy")}
    scored = (driven | {"drive/cte_mean": run.mean("cte_mean_m")}).get(monitor)
    if scored is not None:
        return scored
    by_epoch = run.curves.get(monitor, {}).values()
    return (max if monitor in MAXIMIZED else min)(by_epoch, default=None)


def _score(run: Scored) -> float | None:
    """Return the mean score over the tracks; None without a drive."""
    keys = ("interventions", "driven_s", "cte_mean_m")
    if not run.tracks or any(key not in figures for figures in run.tracks.values() for key in keys):
        return None
    scores = [driving_score(*(figures[key] for key in keys)) for figures in run.tracks.values()]
    return sum(scores) / len(scores)


def _distribution(override: Override) -> BaseDistribution:
    """Convert an override to Optuna's distribution of its values.

    `1,2` is a choice; `range(1,9)` has steps; `interval(1e-4,1e-2)` is continuous; `tag(log,...)`
    draws on a logarithmic scale.
    """
    value, key = override.value(), override.get_key_element()
    log = "log" in getattr(value, "tags", ())
    try:
        if isinstance(value, IntervalSweep):
            whole = isinstance(value.start, int) and isinstance(value.end, int)
            kind: Callable[..., BaseDistribution] = IntDistribution if whole else FloatDistribution
            return kind(value.start, value.end, log=log)
        if isinstance(value, RangeSweep):
            first, stop, step = value.start, value.stop, value.step
            if isinstance(first, int) and isinstance(stop, int) and isinstance(step, int):
                # Hydra excludes the stop as Python does; Optuna includes it.
                return IntDistribution(first, stop - 1, step=1 if log else step, log=log)
        return CategoricalDistribution([str(value) for value in override.sweep_string_iterator()])
    except (TypeError, ValueError) as error:
        raise InputError(f"{key}: {error}") from None


def _check_monitor(
    monitor: str, fixed: Sequence[str], config: DictConfig, context: HydraContext
) -> None:
    if monitor not in MONITORS:
        raise InputError(f"hydra.sweeper.monitor={monitor}: must be one of {', '.join(MONITORS)}")
    job = context.config_loader.load_sweep_config(config, list(fixed))
    if monitor.startswith("drive/") and not OmegaConf.select(job, "callbacks.closed_loop"):
        raise InputError(
            f"hydra.sweeper.monitor={monitor}: the training has no drives; add "
            "callbacks=closed_loop, or set hydra.sweeper.monitor=val/mse"
        )
