"""Find a checkpoint by its file, its run's folder, its name or `latest`; without slow imports.

Some trained networks come with drivezoo. The study `benchmarks/studies/pretrained.yaml` writes
their files: `NAME.ckpt`, and `NAME.json` with what it is, what it was trained on and how it drives.
"""

import functools
import inspect
import json
import os
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import command_line, error_line, shown_path

LATEST = "latest"
OUTPUTS = Path("outputs")  # below the current folder
WEIGHTS_KEY = "model.weights"
FOLDER, BEST, LAST = "checkpoints", "best.ckpt", "last.ckpt"
PACKAGED = Path(__file__).with_name("packaged")
STARTED_IN = "started_in"  # in a card: the folder where the relative paths of its config begin
PATHS = ("root", "images", "rig")  # keys of `data` that name what is read


def trained_data(config: Mapping, facts: object) -> dict:
    """Return a training's `data` config whose paths lead to its recording from any folder.

    Args:
        config: config of the training; another program's may lack `data`.
        facts: facts on the recording, with the folder where the training started.
    """
    section = config.get("data")
    data = dict(section) if isinstance(section, Mapping) else {}
    return data | trained_paths(data, facts.get(STARTED_IN) if isinstance(facts, Mapping) else None)


def trained_paths(data: Mapping, begin: object) -> dict:
    """Return the paths in a training's `data` that lead to their files from another folder only.

    Args:
        data: section of its config, as plain containers.
        begin: folder where the training started; anything else returns no paths.
    """
    if not isinstance(begin, str | Path) or Path(begin) == Path.cwd():
        return {}
    from zoo.base.plain_files import mapped

    def absolute(path: Any) -> Any:
        file = Path(begin, os.path.expanduser(path)) if isinstance(path, str) else None  # noqa: PTH111
        return str(file) if file and not on_server(file) and os.path.lexists(file) else path

    paths = {key: mapped(absolute, data[key]) for key in PATHS if key in data}
    return {key: path for key, path in paths.items() if path != data[key]}


def on_server(paths: object) -> bool:
    r"""Return whether a stranger's path, or one of a list, would contact a server: s3, Windows.

    >>> on_server("s3://bucket/lake"), on_server(["lake", r"\\host\share"]), on_server("/a//b")
    (True, True, False)
    """
    return re.search(r"(^|')(s3:|[\\/])[\\/]", str(paths)) is not None


def find_checkpoint(named: str | Path) -> Path:
    """Return the checkpoint's file that a path, a name or `latest` names.

    Args:
        named: file; run's folder or its `checkpoints` folder, for the best checkpoint, or the last
            if there is no best; `latest`, for the checkpoint of the newest run below `outputs`;
            a network that comes with drivezoo, such as `lenet`. The last two are printed on
            stderr. A file or folder of such a name goes first.

    Raises:
        InputError: the file does not exist, or the folder holds no checkpoint.
    """
    path = Path(os.path.expanduser(named))  # noqa: PTH111 Path.expanduser raises for an unknown user
    packaged = packaged_file(named)
    try:
        if packaged and path.exists():
            note_hidden(path)
        if path.is_file():
            return path
        if path.is_dir():
            return _in_folder(path)
    except (OSError, ValueError) as error:  # no permission for the folder; a NUL in the path
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}); name another checkpoint") from None
    if str(named) == LATEST:
        latest = _in_folder(latest_run())
        print(error_line(LATEST, latest), file=sys.stderr, flush=True)
        return latest
    if packaged:
        print(error_line(str(named), f"comes with drivezoo, {packaged}"), file=sys.stderr)
        return packaged
    runs = runs_below(OUTPUTS)
    hint = f"`{LATEST}` is {checkpoint_of(runs[-1])}" if runs else "drivezoo train trains a network"
    raise InputError(
        f"{path}: no such checkpoint; name a run's folder or its checkpoints/best.ckpt: {hint}; or "
        f"a network that comes with drivezoo: {', '.join(packaged_names())}"
    )


def find_driver(named: Any) -> Any:
    """Return the path of a checkpoint that a user names, as text; a policy unchanged.

    Raises:
        UsageError: it is neither.
        InputError: see `find_checkpoint`.
    """
    if isinstance(named, str | os.PathLike):
        return str(find_checkpoint(os.fspath(named)))
    with suppress(ValueError):  # a function in C, whose arguments are unknown
        try:
            inspect.signature(named).bind(None, 0.0)
        except TypeError:
            raise UsageError(
                f"{named}: is no driver; name a checkpoint's path, a run, or a function of a frame "
                "and mph"
            ) from None
    return named


def find_run(named: str | Path, file: str = "") -> Path:
    """Return the run's folder that a path names; `latest` is the newest below `outputs`.

    Args:
        named: path, or `latest`.
        file: name of a file that the newest run must have.

    Raises:
        InputError: `latest` is named, but there is no run.
    """
    path = Path(os.path.expanduser(named))  # noqa: PTH111
    if str(named) != LATEST or path.exists():
        return path
    latest = latest_run(file)
    print(error_line(LATEST, latest), file=sys.stderr, flush=True)
    return latest


def name_latest(argument: str) -> str:
    """Return `model.weights=PATH` for `model.weights=latest`, and other arguments unchanged.

    A saved config then names the same checkpoint when there are newer runs.

    >>> name_latest("model.weights=a/best.ckpt"), name_latest("seed=1")
    ('model.weights=a/best.ckpt', 'seed=1')

    Raises:
        InputError: there is no run.
    """
    latest = f"{WEIGHTS_KEY}={LATEST}"
    return f"{WEIGHTS_KEY}={find_checkpoint(LATEST)}" if argument == latest else argument


def short_name(path: Path) -> str:
    """Return a path as a user types it: a packaged network's name, or relative if it lies below.

    >>> short_name(Path.cwd() / "outputs" / "run"), short_name(Path("/elsewhere/run"))
    ('outputs/run', '/elsewhere/run')
    """
    path = Path(path).absolute()
    return packaged_name(path) or shown_path(path)


def latest_run(file: str = "") -> Path:
    """Return the folder of the newest run below `outputs` that has a checkpoint, and a file.

    Raises:
        InputError: there is no such run.
    """
    runs = [run for run in runs_below(OUTPUTS) if (run / file).exists()]
    if not runs:
        raise InputError(
            f"{LATEST}: no run below {OUTPUTS.absolute()} holds {file or 'a checkpoint'}; name a "
            "path, or train a network: drivezoo train"
        )
    return runs[-1]


def runs_below(folder: Path) -> list[Path]:
    """Return the folders of runs that have a checkpoint, by start time, the newest last."""
    runs = []
    for run, folders, _ in os.walk(folder):
        if FOLDER in folders and (checkpoint := checkpoint_of(Path(run))):
            folders.remove(FOLDER)
            runs.append((_started(Path(run), checkpoint), str(run)))
    return [Path(run) for _, run in sorted(runs)]


def checkpoint_of(run: Path) -> Path | None:
    """Return a run's best checkpoint, or its last, or None without any."""
    return _best_or_last(run / FOLDER)


def _best_or_last(folder: Path) -> Path | None:
    return next((folder / name for name in (BEST, LAST) if (folder / name).is_file()), None)


def _in_folder(folder: Path) -> Path:
    if checkpoint := checkpoint_of(folder) or (folder.name == FOLDER and _best_or_last(folder)):
        return checkpoint
    if runs := runs_below(folder):
        found_runs = f"holds {len(runs)} runs" if len(runs) > 1 else "is not a run"
        raise InputError(f"{folder}: {found_runs}; name a run, such as {runs[0]}")
    if (folder / ".hydra").is_dir():
        raise InputError(
            f"{folder}: this run has no checkpoint yet (no {FOLDER}/{BEST}); resume it: "
            + command_line(["drivezoo", "train", f"resume={folder}"])
        )
    # The doctor imports this module without packages.
    from zoo.checkpoints.network_files import describe_network

    what = f"is a folder without {FOLDER}/{BEST}; name a run's folder or a checkpoint"
    raise InputError(f"{folder}: {describe_network(folder) or what}")


def _started(run: Path, checkpoint: Path) -> float:
    """Return a run's start time: Hydra writes its config once, and a resumed run keeps it."""
    config = run / ".hydra" / "config.yaml"
    return (config if config.is_file() else checkpoint).stat().st_mtime


@functools.cache
def packaged_names() -> tuple[str, ...]:
    """Return the names of the networks."""
    return tuple(sorted(path.stem for path in PACKAGED.glob("*.ckpt")))


def packaged_file(named: str | Path) -> Path | None:
    """Return the checkpoint of a network that comes with drivezoo; None for another name."""
    return PACKAGED / f"{named}.ckpt" if str(named) in packaged_names() else None


def packaged_name(path: Path) -> str | None:
    """Return the name under which commands take a file; None for a file of the user's.

    A file or folder of that name in the current folder hides the network.
    """
    packaged = path.parent == PACKAGED and packaged_file(path.stem) == path
    return path.stem if packaged and not Path(path.stem).exists() else None


def read_facts(name: str) -> dict[str, Any]:
    """Return the contents of a network's JSON file."""
    return dict(json.loads((PACKAGED / f"{name}.json").read_text(encoding="utf-8")))


@functools.cache
def note_hidden(path: Path) -> None:
    """Print once that a file or folder is used, not the network of its name."""
    kind = "folder" if path.is_dir() else "file"
    line = f"the {kind} of that name here; the network that comes with drivezoo is"
    print(error_line(str(path), f"{line} {PACKAGED / path}.ckpt"), file=sys.stderr, flush=True)
