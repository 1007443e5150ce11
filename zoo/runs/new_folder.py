"""A new folder for what a command writes."""

import datetime
from pathlib import Path

from datamodules.errors import InputError


def new_folder(out: str | None, kind: str, resumed_by: str = "") -> Path:
    """Create and return the folder that `out=` names, or `outputs/<kind>/<date>/<time>`.

    A folder that contains only the file `resumed_by` counts as empty.

    Raises:
        InputError: the folder is not empty, or cannot be written to.
    """
    now = datetime.datetime.now()
    folder = Path(out or f"outputs/{kind}/{now:%Y-%m-%d}/{now:%H-%M-%S-%f}").expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(one.name != resumed_by for one in folder.iterdir()):
            raise InputError(f"{folder}: is not empty; name another folder with out=")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written to ({error.strerror})") from None
    return folder
