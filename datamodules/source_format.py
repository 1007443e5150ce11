"""Which format a folder has, by the names of its files."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal

from zoo.base.bounded_files import read_json
from zoo.base.errors import InputError

Format = Literal["udacity", "lerobot", "donkeycar"]

LOG_NAME = "driving_log.csv"
INFO = "meta/info.json"  # of a LeRobotDataset
MANIFEST = "manifest.json"  # of a tub; one of Donkeycar 3 has a file for each record
SOURCE_NAME = "source.json"  # beside the log of a converted recording
NAMES: dict[Format, str] = {
    "udacity": "recording",
    "lerobot": "LeRobotDataset v3",
    "donkeycar": "Donkeycar tub",
}

_OLD_RECORD = re.compile(r"record_(\d{1,9})\.json")


def find_format(folder: Path) -> Format:
    """Return the format of the recording in a folder.

    Raises:
        InputError: there is no such folder, or it has none of the formats.
    """
    if not folder.is_dir() and folder.name != LOG_NAME:
        raise InputError(f"{folder}: no such folder; name the folder of a recording")
    found = known_format(folder)
    if found is None:
        raise InputError(
            f"{folder}: holds no {LOG_NAME}, no {INFO} (LeRobot) and no {MANIFEST} (Donkeycar); "
            "name the folder that has one"
        )
    return found


def known_format(folder: Path) -> Format | None:
    """Return the format of the recording in a folder, None if it has none of them."""
    if (folder / LOG_NAME).exists() or (folder.name == LOG_NAME and folder.is_file()):
        return "udacity"
    if (folder / INFO).exists():
        return "lerobot"
    if (folder / MANIFEST).exists() or any(True for _ in old_records(folder)):
        return "donkeycar"
    return None


def old_records(folder: Path) -> Iterator[tuple[int, Path]]:
    """Yield the number and path of each record of Donkeycar 3, in no order."""
    found = ((_OLD_RECORD.fullmatch(path.name), path) for path in folder.glob("record_*.json"))
    return ((int(match[1]), path) for match, path in found if match)


def write_source(folder: Path, source: str) -> None:
    """Write which format a recording was converted from: its cameras and car are of that rig."""
    (folder / SOURCE_NAME).write_text(f'{{"version": 1, "format": "{source}"}}\n', encoding="utf-8")


def read_source(folders: Iterable[str | Path]) -> str | None:
    """Return the format that one of the recordings was converted from; None for Udacity's rig.

    Raises:
        InputError: the file that names the format is damaged.
    """
    for folder in folders:
        path = Path(folder) / SOURCE_NAME
        if path.is_file():
            found = read_json(path)
            source = found.get("format") if isinstance(found, dict) else None
            if source not in NAMES:
                raise InputError(f"{path}: format: must be one of {', '.join(NAMES)}")
            return str(source)
    return None
