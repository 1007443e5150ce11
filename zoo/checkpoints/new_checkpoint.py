"""Contents and bytes of a checkpoint that no training wrote.

A lean checkpoint has only what driving needs, for other people and machines.
"""

import io
import re
from typing import Any

import torch

from zoo.base.plain_files import mapped
from zoo.checkpoints.checkpoint import PREFIX
from zoo.checkpoints.checkpoint_path import STARTED_IN

SUFFIX = ".ckpt"
# The folders before the last name of an absolute path, at the begin of a text or of a value in it.
_FOLDERS = re.compile(
    r"((?:^|[=,\[:'\"\s]))(?:file://)?(?:~|\.\.|[A-Za-z]:)?[/\\](?:[^,\]'\"]*[/\\](?=[^/\\,\]'\"]))?"
)
# The folder where a training started, and sections that may name servers, users and passwords.
_PRIVATE = (STARTED_IN, "logger")


def without_private(facts: dict) -> dict:
    """Return a checkpoint's card, config or data without what is not for other people."""
    return {key: value for key, value in facts.items() if key not in _PRIVATE}


def lean_contents(contents: dict) -> dict:
    """Return a checkpoint's weights and card, without optimizer, callbacks and private paths.

    Args:
        contents: contents of a checkpoint's file, see `read_checkpoint_file`.
    """
    card = without_private(contents["drivezoo"])
    state = contents["state_dict"]
    return {
        "drivezoo": {**card, "config": without_folders(without_private(card["config"]))},
        "state_dict": {name: tensor for name, tensor in state.items() if name.startswith(PREFIX)},
    }


def checkpoint_bytes(contents: dict) -> bytes:
    """Return a checkpoint's file; the same contents have the same bytes."""
    buffer = io.BytesIO()
    torch.save(contents, buffer)
    return buffer.getvalue()


def without_folders(value: Any) -> Any:
    """Return plain containers in which an absolute path has only its last name.

    A folder's name can hold a user's name.

    >>> without_folders({"root": ["/home/ann/lake", "outputs/lake"], "track": "lake"})
    {'root': ['lake', 'outputs/lake'], 'track': 'lake'}
    >>> without_folders("data.root=/home/ann/lake")
    'data.root=lake'
    """
    return mapped(lambda text: _FOLDERS.sub(r"\1", text) if isinstance(text, str) else text, value)
