"""Which format a folder has."""

from pathlib import Path
from typing import Literal

from datamodules.errors import InputError
from datamodules.exchange.lerobot_layout import INFO
from datamodules.exchange.tub_import import is_tub
from datamodules.recording import LOG_NAME

Format = Literal["udacity", "lerobot", "donkeycar"]


def find_format(folder: Path) -> Format:
    """Return the format of the recording in a folder.

    Raises:
        InputError: there is no such folder, or it has none of the formats.
    """
    if folder.name == LOG_NAME and folder.is_file():
        return "udacity"
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the folder of a recording")
    if (folder / LOG_NAME).exists():
        return "udacity"
    if (folder / INFO).exists():
        return "lerobot"
    if is_tub(folder):
        return "donkeycar"
    raise InputError(
        f"{folder}: holds no {LOG_NAME}, no {INFO} (LeRobot) and no manifest.json (Donkeycar); "
        "name the folder that has one"
    )
