"""`drivezoo train`: train, test and report one experiment, resume it, or sweep."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.command import is_help
from zoo.base.console_progress import loading
from zoo.base.errors import InputError, UsageError
from zoo.base.run_command import exit_after
from zoo.checkpoints.checkpoint_path import find_run, name_latest
from zoo.training.host_settings import limit_spinning

if TYPE_CHECKING:
    from omegaconf import DictConfig

MOST_SEEDS = 100

# Slow imports (torch, lightning, albumentations) come late: --help and typos answer at once, and
# run_command catches Ctrl-C during them.


def train_or_sweep(arguments: list[str]) -> None:
    """Train, test and report one experiment, or with `-m` or `seeds=5` a sweep."""
    arguments = each_seed(arguments)
    if is_help(arguments):
        from zoo.base.compose import config_help

        print(config_help(arguments))
    elif is_sweep(arguments) and not any(map(is_resume, arguments)):
        limit_spinning()
        from zoo.base.compose import one_line_errors
        from zoo.training.start_sweep import sweep

        with one_line_errors(arguments):
            sweep([name_latest(argument) for argument in arguments])
    else:
        train(arguments)


def train(arguments: list[str], several: bool = True) -> Path:
    """Train once in a new folder, or resume the run of `resume=FOLDER`; return the run's folder.

    Args:
        arguments: overrides of the config.
        several: whether the training may start further processes with the same command.
    """
    limit_spinning()
    with loading("reading the config"):
        import hydra.core.hydra_config  # noqa: F401 - a slow import of train_once

        from zoo.base.compose import refuse_repeated

    refuse_repeated(arguments)
    arguments = [name_latest(argument) for argument in arguments]
    resumed = [argument for argument in arguments if is_resume(argument)]
    if resumed:
        overrides = [word for word in arguments if word not in resumed]
        if is_sweep(overrides):
            raise UsageError(f"{resumed[0]}: is one run, but -m starts a sweep; leave out -m")
        from zoo.training.resume import resume

        folder = find_run(resumed[0].removeprefix("resume="))
        resume(folder, overrides)
        return folder
    from zoo.base.compose import one_line_errors

    with one_line_errors(arguments):
        return train_once(arguments, several)


def is_resume(argument: str) -> bool:
    """Return whether an argument names a run to resume."""
    return argument.startswith("resume=")


def train_once(arguments: list[str], several: bool = True) -> Path:
    """Train once in a new folder, and return it; for the arguments see `train`."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.errors import HydraException

    from zoo.base.compose import hydra_overrides
    from zoo.base.process_ranks import needs_processes
    from zoo.runs.run_folder import is_folder_named, run_in_folder

    failures: list[Exception] = []
    folder, began, typed = Path(), False, sys.argv

    def train(config: "DictConfig") -> None:
        nonlocal began, folder
        began = True
        folder = Path(HydraConfig.get().runtime.output_dir)
        try:
            check_data(config, folder)
            with loading():
                from zoo.training.run import run_experiment
            if not several and needs_processes(config):
                raise UsageError(
                    f"trainer.devices={config.trainer.devices}: only the command drivezoo train "
                    "starts several processes; set trainer.devices=1 trainer.strategy=auto"
                )
            run_experiment(config, folder)
        except Exception as error:  # Hydra would print lines of its own
            failures.append(error)

    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises its errors instead of printing them
    try:
        run_in_folder(hydra_overrides(arguments), train, several)
    except OSError as error:
        if began or isinstance(error, HydraException):  # a missing config is an OSError, too
            raise
        named = error.filename or next(filter(is_folder_named, arguments), "outputs")
        raise InputError(
            f"{named}: cannot be the run's folder ({error.strerror or error}); name another one "
            "with hydra.run.dir=FOLDER"
        ) from error
    finally:
        sys.argv = typed
    if failures:
        raise failures[0]
    return folder


def check_data(config: "DictConfig", folder: Path) -> None:
    """Report a recording that does not exist, before torch is imported, as a failure of the run."""
    from datamodules.recording_format import check_roots
    from zoo.base.process_ranks import is_first_process, needs_processes
    from zoo.runs.status import run_status

    try:
        check_roots(config.data.get("root"))
    except InputError:
        with run_status(folder, is_first_process(needs_processes(config))):
            raise


def each_seed(arguments: list[str]) -> list[str]:
    """Return the arguments with `seeds=3` written as a sweep, `-m seed=1,2,3`.

    Raises:
        UsageError: the number is wrong, or seed=, resume= or Optuna is given, too.
    """
    typed = [argument for argument in arguments if argument.startswith("seeds=")]
    if not typed:
        return arguments
    others = [argument for argument in arguments if argument not in typed]
    count = typed[0].removeprefix("seeds=")
    if len(typed) > 1 or count not in map(str, range(1, MOST_SEEDS + 1)):
        raise UsageError(f"{typed[-1]}: must be one whole number in 1..{MOST_SEEDS}")
    clashing = ("seed=", "resume=", "hydra/sweeper=optuna")  # Optuna would choose the luckiest seed
    if other := [word for word in others if word.startswith(clashing)]:
        raise UsageError(f"{typed[0]}: stands for seed=1,2,...; drop it or {other[0]}")
    return ["-m", *others, f"seed={','.join(map(str, range(1, int(count) + 1)))}"]


def is_sweep(arguments: list[str]) -> bool:
    """Return whether the arguments start a sweep."""
    return any(argument in ("-m", "--multirun", "hydra.mode=MULTIRUN") for argument in arguments)


if __name__ == "__main__":
    exit_after("drivezoo train", train_or_sweep)
