"""Drivers of an entry of the benchmark: a baseline, or checkpoints."""

from collections.abc import Sequence
from pathlib import Path

from zoo.base.errors import InputError, UsageError
from zoo.base.regular_file import hash_file
from zoo.benchmark.baselines import BASELINES
from zoo.benchmark.result import Driver
from zoo.benchmark.suite import Suite
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.worlds.run_drives import load_kept


def find_drivers(names: Sequence[str], suite: Suite) -> list[Driver]:
    """Return the drivers of an entry: one baseline, or checkpoints of several training seeds.

    Raises:
        UsageError: a baseline is named together with other drivers.
        InputError: a checkpoint cannot be read, is named twice or has another network than the
            first; or the suite has no mean steering.
    """
    if baselines := [one for one in names if one in BASELINES]:
        if len(names) > 1:
            raise UsageError(f"{baselines[0]}: a baseline is an entry of its own; name it alone")
        if names[0] == "mean" and suite.mean_steering is None:
            raise InputError(
                f"mean: the suite {suite.name} has no mean_steering; add it to the suite's file"
            )
        facts = {"sha256": None, "parameters": 0, "training_seed": None, "data": ""}
        return [Driver(file=names[0], model=names[0], **facts)]
    drivers = [read_driver(find_checkpoint(one)) for one in names]
    check_distinct(drivers)
    return drivers


def check_distinct(drivers: Sequence[Driver], place: str = "") -> None:
    """Raise InputError unless an entry's checkpoints are different ones of one network."""
    for number, one in enumerate(drivers):
        if one.model != drivers[0].model:
            raise InputError(
                f"{place}{one.file}: is a {one.model}, but {drivers[0].file} is a "
                f"{drivers[0].model}; the checkpoints of an entry differ only in their seed"
            )
        if one.sha256 in [other.sha256 for other in drivers[:number]]:
            raise InputError(f"{place}{one.file}: is named twice; name each training seed once")


def read_driver(path: Path) -> Driver:
    """Return the description of a checkpoint.

    Raises:
        InputError: the checkpoint cannot be read.
    """
    policy = load_kept(str(path))
    seed = policy.config.get("seed")
    return Driver(
        file=str(path),
        sha256=hash_file(path),
        model=policy.name,
        parameters=policy.parameters,
        training_seed=seed if isinstance(seed, int) else None,
        data=str(policy.data.get("fingerprint") or ""),
    )
