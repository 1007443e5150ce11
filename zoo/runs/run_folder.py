"""The folder of a new run that the user names: claimed before Hydra writes into it."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from datamodules.errors import InputError
from zoo.cli.compose import conf_folder, quote
from zoo.cli.process_ranks import is_first_process, needs_processes
from zoo.runs.status import claim_run

KEY = "hydra.run.dir="
# What a run leaves that another would replace.
TRACES = (".hydra", "status.json", "checkpoints")


@contextmanager
def claimed_folder(arguments: list[str]) -> Iterator[list[str]]:
    """Claim the folder that `hydra.run.dir=` names, if it does, for a run that starts within.

    Yields the arguments, which name the folder as it was claimed. A folder in which Hydra has
    written nothing is left as it was.

    Raises:
        InputError: the folder holds a run, or another process trains there.
        OSError: it cannot be created.
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
    """Whether an argument names the run's folder."""
    return argument.lstrip("+").startswith(KEY)


def check_name(folder: Path) -> None:
    """Raise InputError for a folder that Hydra would take for an interpolation and fail to write
    its config into."""
    if "${" in str(folder.absolute()):
        raise InputError(
            f"{folder.absolute()}: Hydra cannot write a run where a folder's name has ${{ in it; "
            f"name another: {KEY}FOLDER"
        )


def _composed_folder(arguments: list[str]) -> Path | None:
    """Return the named folder; None in a process that only helps the one that claims it, and where
    Hydra only prints the config, or reads another than ours."""
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
            f"{folder}: holds a run ({found}), which is kept; resume it with resume={folder}, or "
            "name another folder: hydra.run.dir=FOLDER"
        )


def _remove(folder: Path, created: list[Path]) -> None:
    shutil.rmtree(folder / ".hydra", ignore_errors=True)
    for name in ("status.json", "status.lock"):
        with suppress(OSError):
            (folder / name).unlink()
    for one in created:
        with suppress(OSError):
            one.rmdir()
