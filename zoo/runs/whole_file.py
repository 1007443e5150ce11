"""Replace files in one step, so that they are complete even if the process is killed."""

import json
import math
import os
import re
import secrets
from pathlib import Path

import numpy as np

from datamodules.errors import InputError

_PART = re.compile(r"\..+\.[0-9a-f]{16}\.part")
# Temporary files of earlier versions.
_EARLIER = re.compile(r".+\.ckpt\.part|\.(index\.html|report\.md|.+\.png)\.part")


def json_text(value: object) -> str:
    r"""Return JSON, with null for NaN and infinity.

    >>> json_text({"a": [float("nan"), 1]})
    '{\n  "a": [\n    null,\n    1\n  ]\n}\n'
    """
    return json.dumps(_without_nan(value), indent=2, allow_nan=False) + "\n"


def _without_nan(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_nan(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def write_whole(path: Path, data: str | bytes | memoryview) -> Path:
    """Write a new file next to a file, then rename it to the file; return the path.

    The new file's name is random and must not exist. So no link is followed that another person has
    put there, or in place of the file.

    Raises:
        OSError: the file cannot be written; names the file, and keeps its old contents.
    """
    contents = data.encode(errors="backslashreplace") if isinstance(data, str) else data
    part = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
    try:
        try:
            # Not from `tempfile`: other users could not read its files.
            with part.open("xb") as file:
                file.write(contents)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    return path


def remove_parts(folder: Path) -> None:
    """Remove the temporary files that killed processes have left in a folder."""
    try:
        found = [one for one in folder.iterdir() if _is_part(one.name)]
        for one in found:
            one.unlink(missing_ok=True)
    except OSError:  # no such folder, or another user's file
        return


def refuse_links_out(folder: Path) -> None:
    """Refuse a folder, which may come from another person, with a link that leads out of it.

    Raises:
        InputError: names the link.
    """
    own = os.path.realpath(folder)
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(place, name)
            if not path.is_symlink():
                continue
            target = os.path.realpath(path)
            if target != own and not target.startswith(own + os.sep):
                raise InputError(
                    f"{path}: is a link out of {folder} to {target}, which would be overwritten; "
                    "remove the link, or replace it by a copy"
                )


def _is_part(name: str) -> bool:
    return bool(_PART.fullmatch(name) or _EARLIER.fullmatch(name))
