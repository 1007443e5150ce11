"""Checks of resumed sweeps: which overrides a saved `sweep.json` may contain.

A sweep that the user types may set anything. A sweep's folder can come from another person: its
overrides may only name choices of this package, and each job's config is checked like that of a
saved run.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf

from zoo.base.errors import InputError
from zoo.base.parts import KEY
from zoo.cli.compose import choices, config_groups, quote_paths
from zoo.runs.saved_config import TRUST, check_saved_config

LAUNCHERS = ("basic", "joblib", "ray", "slurm", "submitit_local", "submitit_slurm")
SWEEPERS = ("basic", "grid", "optuna")
# Allowed `hydra.*` keys: numbers and names; none of them sets a class, a command or a path.
HYDRA_KEYS = (
    *(f"hydra.launcher.{key}" for key in ("n_jobs", "batch_size", "verbose")),
    *(f"hydra.launcher.{key}" for key in ("timeout_min", "nodes", "cpus_per_task", "mem_gb")),
    *(f"hydra.launcher.{key}" for key in ("gpus_per_node", "partition", "array_parallelism")),
    *(f"hydra.launcher.task.{key}" for key in ("num_cpus", "num_gpus")),
    *(f"hydra.sweeper.{key}" for key in ("n_trials", "at_once", "monitor", "study", "sampler")),
    *(f"hydra.sweeper.{key}" for key in ("seed", "pruner", "startup_trials", "warmup_epochs")),
    "hydra.sweep.subdir",  # set for each job
    "hydra.verbose",
)
PRUNING = "callbacks.pruning"  # callback that a search adds to its jobs


@dataclass(frozen=True)
class SavedSweep:
    """A sweep that is resumed from its folder.

    Attributes:
        source: file of its overrides.
        trusted: names of classes and keys that the user allows.
    """

    source: Path
    trusted: tuple[str, ...]


_resumed: ContextVar[SavedSweep | None] = ContextVar("resumed", default=None)


@contextmanager
def resumed_from(sweep: SavedSweep) -> Iterator[None]:
    """Check each job that is composed inside the `with` block, see `check_job`."""
    token = _resumed.set(sweep)
    try:
        yield
    finally:
        _resumed.reset(token)


def check_job(overrides: Sequence[str], config: DictConfig, added: Sequence[str] = ()) -> None:
    """Refuse a job of a resumed sweep whose overrides or config are not allowed.

    Args:
        overrides: overrides of the job.
        config: config composed from them.
        added: those overrides that a search added.

    Raises:
        InputError: see `check_overrides` and `check_saved_config`.
    """
    sweep = _resumed.get()
    if sweep is None:
        return
    check_overrides([word for word in overrides if word not in added], sweep)
    own = OmegaConf.masked_copy(config, [key for key in config if key != "hydra"])
    # `check_overrides` has checked the study's address, as `hydra.sweeper.storage`.
    trusted = [*sweep.trusted, *([f"{PRUNING}.storage"] if added else [])]
    check_saved_config(own, sweep.source, trusted)


def check_overrides(overrides: Sequence[str], sweep: SavedSweep) -> None:
    """Refuse overrides that change Hydra itself, or name a choice from outside the package.

    Raises:
        InputError: an override is not allowed; the message names it and the name for `trust=`.
    """
    for flag in overrides:
        if flag.startswith("-"):
            _refuse(flag, flag.partition("=")[0], sweep)
    given = [word for word in overrides if not word.startswith("-")]
    for override in OverridesParser.create().parse_overrides(quote_paths(given, sweep=True)):
        key = override.get_key_element().lstrip("+~")
        if key not in sweep.trusted and not _is_allowed(override, key):
            _refuse(override.input_line, key, sweep)


def _is_allowed(override: Override, key: str) -> bool:
    groups = {name: choices(name) for name in config_groups()}
    groups |= {"hydra/launcher": LAUNCHERS, "hydra/sweeper": SWEEPERS}
    if key in groups:
        return override.is_delete() or set(_chosen(override)) <= {*groups[key], "None"}
    if "/" in key or "@" in key or key == "hydra":
        return False
    if key.startswith("hydra."):
        return key in HYDRA_KEYS
    return not key.startswith(PRUNING)


def _chosen(override: Override) -> Iterator[str]:
    """Yield every choice of a group in an override, from a sweep or a list."""
    values = override.sweep_iterator() if override.is_sweep_override() else [override.value()]
    for value in values:
        yield from map(str, value if isinstance(value, list) else [value])


def _refuse(text: str, name: str, sweep: SavedSweep) -> None:
    if name in sweep.trusted:
        return
    remedy = f"if you know it and trust it, add {TRUST}={name:.200}"
    if name in config_groups():  # a choice that drivezoo lacks
        remedy = f"if it is from a file of yours, add {KEY}=FILE.py; {remedy}"
    raise InputError(
        f"{sweep.source}: {text!r:.200} is not allowed in a saved sweep, nothing was run; {remedy}"
    )
