"""The config that a run trains with, settled from the config that the user typed.

`settle_config` gives a network the settings that the file of its weights tells, `data` and `model`
the same windows, applies `quick`, and records `data=lake` once, on first use.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from filelock import FileLock
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.recording_format import read_recordings
from zoo.base.compose import escape_interpolation, plain_dict
from zoo.base.conf_files import choice_files
from zoo.base.errors import InputError, file_errors, placed_errors
from zoo.base.machine import usable_cores
from zoo.base.new_folder import RECIPE, whole_folder
from zoo.base.plain_files import read_json
from zoo.base.terminal import counted, print_line
from zoo.base.whole_file import write_whole
from zoo.models.frame_window import Window
from zoo.models.make_network import FileNetwork, network_class, view_of
from zoo.training.config_values import check_config

QUICK_EPOCHS = 3
MOST_JOBS = 8  # processes that draw if the user names no number: each opens its tracks


def settle_config(config: DictConfig, console: Console) -> DictConfig:
    """Return the config to train with.

    It sets what the file of weights tells and the windows, applies `quick`, checks all values, and
    then records `data.record`.
    """
    settled = with_quick(settle_windows(with_file_settings(config)))
    check_config(settled)
    return with_recording(settled, console)


def with_quick(config: DictConfig) -> DictConfig:
    """Return a config whose epochs and samples are capped if `quick=true`.

    Its `quick` is false if the training is not longer without it, as that of `first_try`.

    Raises:
        InputError: `quick` is not true or false, or `quick_samples` not a whole number above 0.
    """
    if not isinstance(config.quick, bool):
        raise InputError(f"quick={config.quick}: must be true or false")
    samples = config.quick_samples
    if type(samples) is not int or samples < 1:
        raise InputError(f"quick_samples={samples} is not a whole number above 0")
    if not config.quick:
        return config
    config = config.copy()
    config.quick = False
    for node, key, most in (
        (config.trainer, "max_epochs", QUICK_EPOCHS),
        (config.data, "samples_per_epoch", samples),
    ):
        # Anything else is refused later.
        if node[key] is None or (isinstance(node[key], int | float) and node[key] > most):
            node[key], config.quick = most, True
    if isinstance(least := config.trainer.get("min_epochs"), int):
        config.trainer.min_epochs = min(least, QUICK_EPOCHS)
    return config


def settle_windows(config: DictConfig) -> DictConfig:
    """Return a config in which `data` and `model` have the same windows.

    A value of `data` is written into `model`; null takes the value of `model`.

    Raises:
        InputError: `data` asks for windows that the network does not take.
    """
    config = config.copy()
    for key, single in vars(Window()).items():  # of networks without the key
        asked = config.data.get(key)
        if key in config.model:
            config.model[key] = settled = config.model[key] if asked is None else asked
        elif asked is None or asked == single:
            settled = single
        else:
            names = ", ".join(models_with(key)) or "none yet"
            raise InputError(
                f"data.{key}={asked}: model={config.model.name} does not take it; set "
                f"data.{key}=null, or a model that takes it: {names}"
            )
        OmegaConf.update(config, f"data.{key}", settled, force_add=True)
    return config


def models_with(key: str) -> list[str]:
    """Return the names of the models whose YAML has a key."""
    files = choice_files("model")
    return [name for name in sorted(files) if key in OmegaConf.load(files[name])]


def with_file_settings(config: DictConfig) -> DictConfig:
    """Return a config with the settings that its network takes from the file of its weights.

    A config of a network without such settings, or with all of them, is returned as it is.

    Raises:
        InputError: see `zoo.models.make_network.FileNetwork.file_settings`.
    """
    kind = network_class(config.model.get("_target_"))
    if not issubclass(kind, FileNetwork):
        return config
    model = plain_dict(config.model)
    if settings := kind.file_settings(model, view_of(model, config.data.crop)):
        config = config.copy()
        config.model.update(settings)
    return config


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
    recipe = plain_dict(wanted)
    folder = Path(recipe.pop("out"))
    # Neither is an option of the drives: the fingerprint is of the rows, and any number of
    # processes writes the same files.
    fingerprint, jobs = recipe.pop("fingerprint", None), recipe.pop("jobs", None)
    with file_errors(folder, "cannot record there ({}); set data.record.out=FOLDER"):
        if not (folder / RECIPE).is_file():
            folder.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(f"{folder}.lock"):
                if not (folder / RECIPE).is_file():  # another process may have recorded it
                    _record(folder, recipe, jobs, console)
    if read_json(folder / RECIPE) != json.loads(json.dumps(recipe)):
        raise InputError(
            f"{folder / RECIPE}: {folder} was recorded with other options than data.record now "
            "has; remove it, or set data.record.out to another folder"
        )
    if fingerprint is not None:
        digest = read_recordings(str(folder)).fingerprint()
        if digest != str(fingerprint):
            raise InputError(
                f"{folder}: the recording's fingerprint is {digest}, data.record.fingerprint is "
                f"{fingerprint}: its rows were changed, or other code recorded them; remove it to "
                "record again, or set data.record.fingerprint=null to train on it"
            )
    config = config.copy()
    config.data.root = escape_interpolation(str(folder))
    return config


def _record(folder: Path, recipe: dict, jobs: int | None, console: Console) -> None:
    """Record into a hidden folder, which gets its name when the recording is complete."""
    # Training on other recordings must work without Panda3D.
    from zoo.simulator.record import RecordOptions, record_laps

    if folder.exists():
        raise InputError(
            f"{folder}: exists but holds no {RECIPE}; remove it, or name your own recording "
            "with data.root=FOLDER"
        )
    drives = counted(len(recipe["passes"]), "drive")
    print_line(console, f"recording {drives} with the embedded simulator, once, in {folder}")
    try:
        with placed_errors("data.record"), whole_folder(folder, "data.record.out=") as unfinished:
            common: dict[str, Any] = {"out": str(unfinished), "relative": True}
            passes = [RecordOptions(**common, **options) for options in recipe["passes"]]
            # Half a lap takes less time than starting another process is worth.
            long = sum(options.laps for options in passes) >= 1
            jobs = jobs or (min(usable_cores(), MOST_JOBS) if long else 1)
            record_laps([replace(options, jobs=jobs) for options in passes], console)
            write_whole(unfinished / RECIPE, json.dumps(recipe, indent=1))
    except TypeError as error:
        raise InputError(f"data.record.passes: {error}; see drivezoo simulator record") from None
