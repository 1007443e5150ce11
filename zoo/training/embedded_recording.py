"""`data=lake`: a recording that the embedded simulator makes on first use, and never again."""

import json
import shutil
from pathlib import Path

from filelock import FileLock
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.errors import InputError
from zoo.cli.compose import escape_interpolation
from zoo.runs.saved_config import RECIPE


def with_recording(config: DictConfig, console: Console) -> DictConfig:
    """Return a config whose `data.root`, if not set, is the recording of `data.record`, made here.

    Two runs that start at once make it once. A recording that was stopped is begun anew.

    Raises:
        InputError: an option of `data.record` that cannot be, a folder that can't be written, or
            one that was recorded with other options.
    """
    wanted = config.data.get("record")
    if wanted is None or config.data.root is not None:
        return config
    recipe = OmegaConf.to_container(wanted, resolve=True)
    folder = Path(recipe.pop("out"))
    try:
        if not (folder / RECIPE).is_file():
            folder.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(f"{folder}.lock"):
                if not (folder / RECIPE).is_file():  # another process may have recorded it
                    _record(folder, recipe, console)
    except OSError as error:
        raise InputError(f"{folder}: cannot record there: {error.strerror}") from None
    _check_recipe(folder, recipe)
    config = config.copy()
    config.data.root = escape_interpolation(str(folder))
    return config


def _record(folder: Path, recipe: dict, console: Console) -> None:
    """Into a folder beside, which takes its name when all is there."""
    # Panda3D need not be there for those who train on recordings of their own.
    from simulator.errors import SimulatorError
    from simulator.record import RecordOptions, record_laps

    if folder.exists():
        raise InputError(
            f"{folder}: is in the way and holds no {RECIPE}: remove it, or name your own recording "
            "with data.root=FOLDER"
        )
    unfinished = Path(f"{folder}.part")
    shutil.rmtree(unfinished, ignore_errors=True)
    console.print(
        f"recording {len(recipe['passes'])} drives with the embedded simulator, once, in {folder}",
        highlight=False,
        markup=False,
    )
    try:
        passes = [
            RecordOptions(out=str(unfinished), relative=True, **one) for one in recipe["passes"]
        ]
        record_laps(passes, console)
    except SimulatorError as error:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise InputError(f"data.record: {error}") from None
    except TypeError as error:
        raise InputError(f"data.record.passes: {error}; see python -m simulator record") from None
    (unfinished / RECIPE).write_text(json.dumps(recipe, indent=1))
    unfinished.rename(folder)


def _check_recipe(folder: Path, recipe: dict) -> None:
    from zoo.runs.bounded_files import read_json

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
            "options than data.record now has: remove it, or set data.record.out to another folder"
        )
