"""Compose a run's config, and claim the folder that the user names before Hydra writes there."""

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from omegaconf import DictConfig

from zoo.base.compose import conf_folder, quote
from zoo.base.errors import InputError, library_errors
from zoo.base.process_ranks import is_first_process, needs_processes
from zoo.base.terminal import command_line
from zoo.runs.status import claim_run, read_status

KEY = "hydra.run.dir="
# Files and folders that a run writes, and would replace.
TRACES = (
    *(".hydra", "status.json", "checkpoints", "drives", "plots", "report"),
    *("metrics.json", "metrics.csv", "split.csv", "hparams.yaml"),
)
EMPTY = [".hydra", "status.json"]  # of a run that failed before it trained, as by a typo


def run_in_folder(arguments: list[str], task: Callable[[DictConfig], None], logs: bool) -> None:
    """Call a function with the config of the arguments, as `hydra.main` does, in the run's folder.

    `hydra.main` composes the config twice.

    Args:
        arguments: overrides of the config, as Hydra reads them. During the call, `sys.argv` has
            them, too: Lightning starts other ranks with it.
        task: function that is called with the config. Its exceptions pass.
        logs: whether Hydra sets the handlers of Python's `logging`; a notebook keeps its own.

    Raises:
        InputError: the folder holds a run, another process trains there, or Hydra is in use here.
        OSError: the folder cannot be created.
    """
    import hydra
    from hydra._internal.callbacks import Callbacks
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.utils import run_job
    from hydra.types import HydraContext, RunMode

    with library_errors("Hydra", "is in use in this process", "end the other training"):
        composing = hydra.initialize_config_dir(str(conf_folder().resolve()), version_base="1.3")
    with composing:
        config = hydra.compose("config", arguments, return_hydra_config=True)
        with _claimed_folder(arguments, config) as claimed:
            sys.argv = [sys.argv[0], *claimed]
            config.hydra.mode, callbacks = RunMode.RUN, Callbacks(config)
            callbacks.on_run_start(config=config, config_name="config")
            context = HydraContext(GlobalHydra.instance().config_loader(), callbacks)
            result = run_job(task, config, "hydra.run.dir", None, context, logs)
            callbacks.on_run_end(config=config, config_name="config", job_return=result)
            _ = result.return_value  # raises what the function raised


@contextmanager
def _claimed_folder(arguments: list[str], config: DictConfig) -> Iterator[list[str]]:
    """Claim the folder that `hydra.run.dir=` names, for a run inside this context.

    Yield the arguments with the claimed folder's name. If Hydra has written nothing there, the
    folder is left as it was before. Without `hydra.run.dir=`, and in every rank but the first,
    nothing is claimed.
    """
    named = [argument for argument in arguments if is_folder_named(argument)]
    if not named or not is_first_process(needs_processes(config)):
        check_name(Path())
        yield arguments
        return
    folder = Path(config.hydra.run.dir)
    check_name(folder)
    _refuse_a_run(folder)  # before a lock file is created there
    created = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        claim_run(folder, _refuse_a_run)
        config.hydra.run.dir = str(folder)  # as it is now: its name may have the time
        others = [argument for argument in arguments if argument not in named]
        yield [*others, f"{KEY}{quote(str(folder))}"]
    except OSError:
        if not (folder / ".hydra" / "config.yaml").is_file():
            _remove(folder, created)
        raise


def is_folder_named(argument: str) -> bool:
    """Return whether an argument names the run's folder."""
    return argument.lstrip("+").startswith(KEY)


def check_name(folder: Path, key: str = KEY) -> None:
    """Raise InputError for a path that Hydra reads as an interpolation, or that is not UTF-8."""
    path = str(folder.absolute())
    if "${" in path or path.encode(errors="ignore").decode() != path:
        raise InputError(
            f"{path}: Hydra and TensorBoard cannot write a run into a path that contains ${{ or is "
            f"not UTF-8; name another folder: {key}FOLDER"
        )


def _refuse_a_run(folder: Path) -> None:
    traces = [name for name in TRACES if (folder / name).exists()]
    if traces and (traces != EMPTY or read_status(folder).get("status") != "failed"):
        raise InputError(
            f"{folder}: already holds a run ({traces[0]}); resume it with "
            f"{command_line([f'resume={folder}'])}, or name another folder: hydra.run.dir=FOLDER"
        )


def _remove(folder: Path, created: list[Path]) -> None:
    shutil.rmtree(folder / ".hydra", ignore_errors=True)
    for name in ("status.json", "status.lock"):
        with suppress(OSError):
            (folder / name).unlink()
    for path in created:
        with suppress(OSError):
            path.rmdir()
