"""Claim the folder that the user names for a new run, before Hydra writes there."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.written_files import MARK
from zoo.cli.compose import conf_folder, quote
from zoo.cli.process_ranks import is_first_process, needs_processes
from zoo.runs.status import claim_run

KEY = "hydra.run.dir="
# Files and folders that a run writes, and would replace.
TRACES = (
    *(".hydra", "status.json", "checkpoints", "drives", "plots", "report"),
    *("metrics.json", "metrics.csv", "split.csv", "hparams.yaml"),
)
OWN = (MARK, "status.lock")


@contextmanager
def claimed_folder(arguments: list[str]) -> Iterator[list[str]]:
    """Claim the folder that `hydra.run.dir=` names, for a run inside this context.

    Yield the arguments with the claimed folder's name. If Hydra has written nothing there, the
    folder is left as it was before. Without `hydra.run.dir=` nothing is claimed.

    Raises:
        InputError: the folder holds a run, or another process trains there.
        OSError: the folder cannot be created.
    """
    named = [one for one in arguments if is_folder_named(one)]
    folder = _composed_folder(arguments) if named else None
    check_name(folder or Path())
    if folder is None:
        yield arguments
        return
    _refuse_a_run(folder)  # before a lock file is created there
    created = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        claim_run(folder, _refuse_a_run)
        others = [one for one in arguments if one not in named]
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


def _composed_folder(arguments: list[str]) -> Path | None:
    """Return the run's folder as Hydra composes it.

    Return None in processes that must not claim it: every rank but the first, and commands in which
    Hydra only prints the config, or reads another config than drivezoo's.
    """
    from hydra import compose, initialize_config_dir
    from hydra._internal.utils import get_args_parser

    flags = get_args_parser().parse_args(arguments)
    if any((flags.cfg, flags.info, flags.hydra_help, flags.config_name, flags.config_path)):
        return None
    overrides = flags.overrides
    if flags.config_dir:
        overrides = [*overrides, f"hydra.searchpath=[{quote(f'file://{flags.config_dir}')}]"]
    with initialize_config_dir(str(conf_folder().resolve()), version_base="1.3"):
        config = compose("config", overrides, return_hydra_config=True)
    return Path(config.hydra.run.dir) if is_first_process(needs_processes(config)) else None


def _refuse_a_run(folder: Path) -> None:
    found = next((name for name in TRACES if (folder / name).exists()), None)
    if found:
        raise InputError(
            f"{folder}: already holds a run ({found}); resume it with resume={folder}, or "
            "name another folder: hydra.run.dir=FOLDER"
        )


def _remove(folder: Path, created: list[Path]) -> None:
    shutil.rmtree(folder / ".hydra", ignore_errors=True)
    for name in ("status.json", *OWN):
        with suppress(OSError):
            (folder / name).unlink()
    for one in created:
        with suppress(OSError):
            one.rmdir()
