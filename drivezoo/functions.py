"""A function for each command; keywords are the command's keys."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from drivezoo.keywords import checkpoint_of, folder_of, options, overrides
from drivezoo.one_line_errors import one_line_errors

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console

    from drivezoo.served_drive import ServedDrive
    from drivezoo.training import Training
    from zoo.benchmark.benchmarked import Benchmarked
    from zoo.compare.comparison import ComparedEntries
    from zoo.evaluate.evaluation import Evaluation
    from zoo.evaluate.replay_score import Replay
    from zoo.leaderboard.ranking_table import Ranking
    from zoo.results import FinishedRuns

# A checkpoint as the commands take it, what `train` returned, or a policy.
Driver: TypeAlias = "str | Path | Training | Callable[..., Any]"


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
    from zoo.cli.run_command import check_arguments

    if "resume" in keys:
        keys["resume"] = folder_of(keys["resume"])
    arguments = overrides(keys)
    check_arguments(arguments)
    if is_sweep(arguments):
        raise UsageError("hydra.mode=MULTIRUN: call train for each run, or type drivezoo train -m")
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
    from zoo.base.errors import InputError, UsageError
    from zoo.cli.command_config import read_options
    from zoo.evaluate.__main__ import evaluate as evaluate_driver
    from zoo.evaluate.evaluate_options import EvaluateOptions
    from zoo.runs.table_files import write_asked

    if "replay" in keys:
        raise UsageError("replay: call drivezoo.replay(driver, recording)")
    settings = read_options("evaluate", EvaluateOptions, options("evaluate", keys))
    result = evaluate_driver(checkpoint_of(driver), settings, _console())
    write_asked(result, settings.table, settings.plot, settings.columns)
    if result.problem:
        raise InputError(result.problem)
    return result


@one_line_errors
def replay(driver: Driver, recording: str | Path, **keys: Any) -> Replay:
    """Score a checkpoint or a policy on a recording, as `drivezoo replay` does.

    Args:
        driver: see `evaluate`.
        recording: recording's folder.
        **keys: options of the command.

    Raises:
        UsageError: a key or value is wrong.
        InputError: the checkpoint or the recording cannot be used; or the network steered NaN,
            after all files are written.
    """
    from zoo.base.errors import InputError
    from zoo.cli.command_config import read_options
    from zoo.evaluate.replay_score import ReplayOptions, replay_recording

    settings = read_options("replay", ReplayOptions, options("replay", keys))
    result = replay_recording(checkpoint_of(driver), str(recording), settings, _console())
    if result.problem:
        raise InputError(result.problem)
    return result


@one_line_errors
def benchmark(*drivers: str | Path | Training, **keys: Any) -> Benchmarked:
    """Drive the roads of a suite with the checkpoints of an entry, as `drivezoo benchmark` does.

    >>> result = benchmark("run1", "run2", "run3", suite="quick")  # doctest: +SKIP

    Args:
        *drivers: checkpoints that differ in the training seed, or one baseline's name.
        **keys: options of the command.

    Raises:
        UsageError: a key or value is wrong.
        InputError: a checkpoint or the suite cannot be used; or, after all files are written, the
            network steered NaN or a mark of the suite is missed.
    """
    from zoo.base.errors import InputError, UsageError
    from zoo.benchmark.__main__ import BenchmarkOptions
    from zoo.benchmark.__main__ import benchmark as drive_suite
    from zoo.cli.command_config import read_options

    settings = read_options("benchmark", BenchmarkOptions, options("benchmark", keys))
    names = [checkpoint_of(one) for one in drivers]
    if not names or not all(isinstance(one, str) for one in names):
        raise UsageError("benchmark: name checkpoints or a baseline; a result holds their files")
    result = drive_suite(names, settings, _console())
    if result.problem:
        raise InputError(result.problem)
    return result


@one_line_errors
def compare(
    a: str | Path | Benchmarked, b: str | Path | Benchmarked, **keys: Any
) -> ComparedEntries:
    """Compare two results of the benchmark on the same roads, as `drivezoo compare` does.

    Args:
        a: what `benchmark` returned, or its folder.
        b: the other result.
        **keys: options of the command.

    Raises:
        UsageError: a key or value is wrong.
        InputError: a result cannot be read, or the results are of different roads.
    """
    from zoo.cli.command_config import read_options
    from zoo.compare.__main__ import CompareOptions
    from zoo.compare.__main__ import compare as compare_results

    settings = read_options("compare", CompareOptions, options("compare", keys))
    return compare_results(folder_of(a), folder_of(b), settings)[0]


@one_line_errors
def leaderboard(*folders: str | Path, **keys: Any) -> Ranking:
    """Rank all runs below some folders, as `drivezoo leaderboard` does.

    Args:
        *folders: folders that contain runs, sweeps or drives; without any, `outputs`.
        **keys: options of the command.

    Raises:
        UsageError: a key is wrong.
        InputError: a folder does not exist, or contains neither runs nor drives.
    """
    from zoo.cli.command_config import read_options
    from zoo.leaderboard.__main__ import LeaderboardOptions
    from zoo.leaderboard.__main__ import leaderboard as rank_folders

    settings = read_options("leaderboard", LeaderboardOptions, options("leaderboard", keys))
    return rank_folders(folders, settings)[0]


@one_line_errors
def results(*runs: str | Path | Training) -> FinishedRuns:
    """Return the table of finished runs, as `drivezoo results` prints it.

    Args:
        *runs: what `train` returned, or runs' folders.

    Raises:
        InputError: a folder has no figures of a finished run.
    """
    from zoo.results import read_finished

    return read_finished([folder_of(one) for one in runs])


@one_line_errors
def drive(driver: str | Path | Training, **keys: Any) -> ServedDrive | None:
    """Serve a checkpoint to simulators until an interrupt, as `drivezoo drive` does.

    >>> drive("latest", sim="lake", laps=1, port=0)  # doctest: +SKIP

    Args:
        driver: checkpoint's path, run's folder, `latest`, or what `train` returned.
        **keys: options of the command; `speed` takes mph, a controller's name, or its keys.

    Returns:
        The drive; None if no frame came.

    Raises:
        UsageError: a key or value is wrong.
        InputError: the checkpoint cannot be loaded, the port is taken, or the embedded simulator
            failed.
    """
    from drivezoo.served_drive import ServedDrive, kept_signals
    from zoo.checkpoints.checkpoint_path import find_checkpoint
    from zoo.drive.__main__ import serve
    from zoo.drive.drive_settings import read_settings

    settings = read_settings(options("drive", keys))
    path = str(find_checkpoint(checkpoint_of(driver)))
    with kept_signals():
        folder = serve(path, settings)
    return None if folder is None else ServedDrive.read(folder)


def _console() -> Console:
    from rich.console import Console

    from zoo.base.terminal import guard_rich

    guard_rich()
    return Console(emoji=False)
