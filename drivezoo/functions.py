"""A function for each command; keywords are the command's keys."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from drivezoo.one_line_errors import one_line_errors
from zoo.base.command_keys import typed
from zoo.benchmark.__main__ import benchmark as benchmark_command
from zoo.compare.__main__ import compare as compare_command
from zoo.drive.__main__ import drive as drive_command
from zoo.evaluate.__main__ import evaluate as evaluate_command
from zoo.evaluate.__main__ import replay as replay_command
from zoo.leaderboard.__main__ import leaderboard as leaderboard_command
from zoo.results import results as results_command

if TYPE_CHECKING:
    from drivezoo.served_drive import ServedDrive
    from drivezoo.training import Training

evaluate = one_line_errors(evaluate_command)
replay = one_line_errors(replay_command)
benchmark = one_line_errors(benchmark_command)
compare = one_line_errors(compare_command)
leaderboard = one_line_errors(leaderboard_command)
results = one_line_errors(results_command)


@one_line_errors
def train(**keys: Any) -> Training:
    """Train a network, test it, and score it by driving, as `drivezoo train` does.

    >>> run = train(model="lenet", data={"root": "FOLDER"})  # doctest: +SKIP

    Args:
        **keys: overrides of the config; a dict has the keys after a dot. `resume=FOLDER` resumes a
            run. `parts=` names files of the user's own networks, losses, ...

    Raises:
        UsageError: a key or value is wrong, or asks for several processes or runs.
        InputError: the recording or another file cannot be used.
        StoppedError: an interrupt, such as Ctrl-C; names how to resume.
    """
    from drivezoo.training import Training
    from zoo.__main__ import is_sweep
    from zoo.__main__ import train as train_run
    from zoo.base.errors import UsageError
    from zoo.base.run_command import check_arguments

    arguments = overrides(keys)
    check_arguments(arguments)
    if is_sweep(arguments):
        raise UsageError("hydra.mode=MULTIRUN: call train for each run, or type drivezoo train -m")
    return Training.read(train_run(arguments, several=False))


@one_line_errors
def drive(driver: str | os.PathLike[str], **keys: Any) -> ServedDrive | None:
    """Serve a checkpoint to simulators until an interrupt, as `drivezoo drive` does.

    >>> drive("latest", sim="lake", laps=1, port=0)  # doctest: +SKIP

    Args:
        driver: checkpoint's path, run's folder, `latest`, or what `train` returned.
        **keys: keys of the command; `speed` takes mph, a controller's name, or its keys.

    Returns:
        The drive; None if no frame came.

    Raises:
        UsageError: a key or value is wrong.
        InputError: the checkpoint cannot be loaded, the port is taken, or the embedded simulator
            failed.
    """
    from drivezoo.served_drive import ServedDrive, kept_signals

    with kept_signals():
        folder = drive_command(driver, **keys)
    return None if folder is None else ServedDrive.read(folder)


def overrides(keywords: Mapping[str, object]) -> list[str]:
    """Return keywords as overrides of `drivezoo train`; the keys of a dict are joined by dots.

    >>> overrides({"model": "lenet", "data": {"root": "lake", "val_share": 0.2}, "quick": True})
    ['model=lenet', 'data.root=lake', 'data.val_share=0.2', 'quick=true']
    """
    return [f"{key}={typed(value)}" for key, value in _flat(keywords)]


def _flat(keywords: Mapping[str, object], prefix: str = "") -> Iterable[tuple[str, object]]:
    for key, value in keywords.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
