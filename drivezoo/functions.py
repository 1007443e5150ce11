"""A function for each command; keywords are the command's keys."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from drivezoo.keywords import options, overrides
from drivezoo.one_line_errors import one_line_errors

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    from drivezoo.training import Training
    from zoo.evaluate.evaluation import Evaluation

# A checkpoint as the commands take it, what `train` returned, or a policy.
Driver: TypeAlias = "str | Path | Training | Callable[..., Any]"


@one_line_errors
def train(**keys: Any) -> Training:
    """Train a network, test it, and score it by driving, as `python -m zoo` does.

    >>> run = train(model="lenet", data={"root": "FOLDER"})  # doctest: +SKIP

    Args:
        **keys: overrides of the config; a dict has the keys after a dot. `resume=FOLDER` resumes a
            run.

    Raises:
        UsageError: a key or value is wrong, or asks for several processes or runs.
        InputError: the recording or another file cannot be used.
        StoppedError: an interrupt, such as Ctrl-C; names how to resume.
    """
    from datamodules.errors import UsageError
    from drivezoo.training import Training
    from zoo.__main__ import is_sweep
    from zoo.__main__ import train as train_run
    from zoo.cli.run_command import check_arguments

    arguments = overrides({key: _checkpoint(one) for key, one in keys.items()})
    check_arguments(arguments)
    if is_sweep(arguments):
        raise UsageError("hydra.mode=MULTIRUN: call train for each run, or type python -m zoo -m")
    return Training.read(train_run(arguments, several=False))


@one_line_errors
def evaluate(driver: Driver, **keys: Any) -> Evaluation:
    """Score a checkpoint or a policy by driving, as `drivezoo evaluate` does.

    >>> scores = evaluate("latest", track="lake", seeds=3)  # doctest: +SKIP

    Args:
        driver: checkpoint's path, run's folder, `latest`, what `train` returned, or a policy. A
            policy is called with a frame, uint8 [160, 320, 3] RGB, and mph; it drives in this
            process.
        **keys: options of the command.

    Raises:
        UsageError: a key or value is wrong.
        InputError: the checkpoint cannot be used; or the network steered NaN, after all files are
            written.
    """
    from datamodules.errors import InputError
    from zoo.cli.command_config import read_options
    from zoo.evaluate.__main__ import evaluate as evaluate_driver
    from zoo.evaluate.evaluate_options import EvaluateOptions
    from zoo.runs.result_table import write_asked

    settings = read_options("evaluate", EvaluateOptions, options("evaluate", keys))
    result = evaluate_driver(_checkpoint(driver), settings, _console())
    write_asked(result, settings.table, settings.plot)
    if result.problem:
        raise InputError(result.problem)
    return result


def _checkpoint(driver: Any) -> Any:
    """Return the path of a checkpoint as text; other values unchanged."""
    driver = getattr(driver, "checkpoint", driver)
    return str(driver) if isinstance(driver, Path) else driver


def _console() -> Console:
    from rich.console import Console

    from datamodules.terminal import guard_rich

    guard_rich()
    return Console(emoji=False)
