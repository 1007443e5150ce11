"""`data=lake`: record with the embedded simulator once, on first use."""

import json
from dataclasses import replace
from pathlib import Path

from filelock import FileLock
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.recording import read_recordings
from zoo.base.cores import usable_cores
from zoo.base.errors import InputError
from zoo.base.new_folder import RECORDINGS, print_unfinished, whole_folder
from zoo.base.whole_file import write_whole
from zoo.cli.compose import escape_interpolation
from zoo.runs.saved_config import RECIPE

MOST_JOBS = 8  # processes that draw if the user names no number: each opens its tracks


def with_recording(config: DictConfig, console: Console) -> DictConfig:
    """Return a config whose `data.root` is set; record `data.record` if it is not.

    If two runs start at the same time, only one records. A stopped recording is repeated.

    Raises:
        InputError: an option of `data.record` is wrong, the folder cannot be written, it was
            recorded with other options, or its rows have another fingerprint.
    """
    wanted = config.data.get("record")
    if wanted is None or config.data.root is not None:
        return config
    recipe = OmegaConf.to_container(wanted, resolve=True)
    folder = Path(recipe.pop("out"))
    # Neither is an option of the drives: the fingerprint is of the rows, and any number of
    # processes writes the same files.
    fingerprint, jobs = recipe.pop("fingerprint", None), recipe.pop("jobs", None)
    try:
        if not (folder / RECIPE).is_file():
            folder.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(f"{folder}.lock"):
                if not (folder / RECIPE).is_file():  # another process may have recorded it
                    _record(folder, recipe, jobs, console)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot record there ({error.strerror}); set data.record.out=FOLDER"
        ) from None
    _check_recipe(folder, recipe)
    if fingerprint is not None:
        _check_fingerprint(folder, str(fingerprint))
    config = config.copy()
    config.data.root = escape_interpolation(str(folder))
    return config


def _record(folder: Path, recipe: dict, jobs: int | None, console: Console) -> None:
    """Record into a hidden folder, which gets its name when the recording is complete."""
    # Training on other recordings must work without Panda3D.
    from simulator.record import RecordOptions, record_laps

    if folder.exists():
        raise InputError(
            f"{folder}: exists but holds no {RECIPE}; remove it, or name your own recording "
            "with data.root=FOLDER"
        )
    print_unfinished(folder)
    console.print(
        f"recording {len(recipe['passes'])} drives with the embedded simulator, once, in {folder}",
        highlight=False,
        markup=False,
    )
    try:
        with whole_folder(folder, RECORDINGS) as unfinished:
            common = {"out": str(unfinished), "relative": True}
            passes = [RecordOptions(**common, **one) for one in recipe["passes"]]
            if jobs is None:  # half a lap takes less time than starting another process is worth
                jobs = min(usable_cores(), MOST_JOBS) if sum(one.laps for one in passes) >= 1 else 1
            record_laps([replace(one, jobs=jobs) for one in passes], console)
            write_whole(unfinished / RECIPE, json.dumps(recipe, indent=1))
    except InputError as error:
        raise InputError(f"data.record: {error}") from None
    except TypeError as error:
        raise InputError(f"data.record.passes: {error}; see drivezoo simulator record") from None


def _check_recipe(folder: Path, recipe: dict) -> None:
    from zoo.base.bounded_files import read_json

    path, wanted = folder / RECIPE, json.loads(json.dumps(recipe))
    found = read_json(path)
    if not isinstance(found, dict):
        raise InputError(f"{path}: should be keys and values; remove {folder} to record again")
    other = [
        key for key in {**wanted, **found} if key not in found or found[key] != wanted.get(key)
    ]
    if other:
        raise InputError(
            f"{path}: {other[0]} is not data.record.{other[0]}: {folder} was recorded with other "
            "options than data.record now has; remove it, or set data.record.out to another folder"
        )


def _check_fingerprint(folder: Path, wanted: str) -> None:
    found = read_recordings(str(folder)).fingerprint()
    if found != wanted:
        raise InputError(
            f"{folder}: the recording's fingerprint is {found}, data.record.fingerprint is "
            f"{wanted}: its rows were changed, or other code recorded them; remove {folder} to "
            "record again, or set data.record.fingerprint=null to train on it"
        )
