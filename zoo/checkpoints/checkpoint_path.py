"""Where a checkpoint is: a file, a run's folder, or `latest`. Imports nothing that takes long."""

import os
import sys
from pathlib import Path

from datamodules.errors import InputError
from datamodules.terminal import error_line

LATEST = "latest"
OUTPUTS = Path("outputs")  # below the current folder
WEIGHTS_KEY = "model.weights"
FOLDER, BEST, LAST = "checkpoints", "best.ckpt", "last.ckpt"


def find_checkpoint(named: str | Path) -> Path:
    """Return the checkpoint's file that a path or `latest` names.

    Args:
        named: file, which is returned as it is; run's folder, or its `checkpoints`: the best
            checkpoint, or else the last; `latest`, where nothing has that name: the checkpoint of
            the newest run below `outputs`, which is printed on stderr.

    Raises:
        InputError: no such file, or a folder that holds no checkpoint.
    """
    path = Path(os.path.expanduser(named))  # noqa: PTH111 - Path's raises for an unknown user
    try:
        if path.is_file():
            return path
        if path.is_dir():
            return _in_folder(path)
    except (OSError, ValueError) as error:  # a folder that may not be entered; a NUL
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}); name another checkpoint") from None
    if str(named) == LATEST:
        found = checkpoint_of(latest_run())
        assert found is not None  # `latest_run` passes over runs without one
        print(error_line(LATEST, found), file=sys.stderr, flush=True)
        return found
    runs = runs_below(OUTPUTS)
    hint = f"`{LATEST}` is {checkpoint_of(runs[-1])}" if runs else "python -m zoo trains one"
    raise InputError(
        f"{path}: no such checkpoint; name a run's folder or its checkpoints/best.ckpt; {hint}"
    )


def find_run(named: str | Path) -> Path:
    """Return the run's folder that a path names; `latest` is the newest below `outputs`.

    Raises:
        InputError: `latest`, and there is no run.
    """
    path = Path(os.path.expanduser(named))  # noqa: PTH111
    if str(named) != LATEST or path.exists():
        return path
    found = latest_run()
    print(error_line(LATEST, found), file=sys.stderr, flush=True)
    return found


def name_latest(argument: str) -> str:
    """Return `model.weights=PATH` for `model.weights=latest`: a saved config keeps its meaning.

    >>> name_latest("model.weights=a/best.ckpt"), name_latest("seed=1")
    ('model.weights=a/best.ckpt', 'seed=1')

    Raises:
        InputError: there is no run.
    """
    key, _, value = argument.partition("=")
    if key != WEIGHTS_KEY or value != LATEST:
        return argument
    return f"{key}={find_checkpoint(value)}"


def short_name(path: Path) -> str:
    """Return a path as a person would type it: relative where it lies below the current folder.

    >>> short_name(Path.cwd() / "outputs" / "run"), short_name(Path("/elsewhere/run"))
    ('outputs/run', '/elsewhere/run')
    """
    path, here = Path(path).absolute(), Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def latest_run() -> Path:
    """Return the folder of the run that started last, of those below `outputs` with a checkpoint.

    Raises:
        InputError: there is none.
    """
    runs = runs_below(OUTPUTS)
    if not runs:
        raise InputError(
            f"{LATEST}: no run below {OUTPUTS.absolute()} holds a checkpoint; name a checkpoint's "
            "path, or train one: python -m zoo"
        )
    return runs[-1]


def runs_below(folder: Path) -> list[Path]:
    """Return the folders of runs that hold a checkpoint, the one that started last at the end."""
    found = []
    for place, folders, _ in os.walk(folder):
        if FOLDER in folders and (checkpoint := checkpoint_of(Path(place))):
            folders.remove(FOLDER)
            found.append((_started(Path(place), checkpoint), str(place)))
    return [Path(place) for _, place in sorted(found)]


def checkpoint_of(run: Path) -> Path | None:
    """Return a run's best checkpoint, or else its last; None where it has none."""
    return _best_or_last(run / FOLDER)


def _best_or_last(folder: Path) -> Path | None:
    return next((folder / name for name in (BEST, LAST) if (folder / name).is_file()), None)


def _in_folder(folder: Path) -> Path:
    found = checkpoint_of(folder) or (_best_or_last(folder) if folder.name == FOLDER else None)
    if found:
        return found
    if runs := runs_below(folder):
        several = f"holds {len(runs)} runs: name one of them" if len(runs) > 1 else "is no run"
        raise InputError(f"{folder}: {several}, such as {runs[0]}")
    if (folder / ".hydra").is_dir():
        raise InputError(
            f"{folder}: this run has no checkpoint yet (no {FOLDER}/{BEST}); train it further: "
            f"python -m zoo resume={folder}"
        )
    raise InputError(
        f"{folder}: is a folder without {FOLDER}/{BEST}; name a run's folder or a checkpoint"
    )


def _started(run: Path, checkpoint: Path) -> float:
    """Hydra writes a run's config once, when it starts; a resumed run keeps it."""
    config = run / ".hydra" / "config.yaml"
    return (config if config.is_file() else checkpoint).stat().st_mtime
