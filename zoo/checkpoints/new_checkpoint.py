"""Write a checkpoint that no training wrote, without replacing one of a training."""

import io
from collections.abc import Callable
from pathlib import Path

import torch

from datamodules.errors import InputError
from zoo.runs.whole_file import write_whole

SUFFIX = ".ckpt"


def checked_out(out: Path, writer: str, is_own: Callable[[Path], bool]) -> Path:
    """Return the path to write; refuse to replace another file.

    Args:
        out: path that the user named.
        writer: what writes, for the message, such as `import`.
        is_own: function that returns whether the writer wrote an existing file.

    Raises:
        InputError: the path has another suffix, is a folder or another file, or its folder does
            not exist.
    """
    if out.suffix != SUFFIX:
        raise InputError(f"out={out}: must end in {SUFFIX}; name such a file")
    if out.is_dir() or not out.parent.is_dir():
        reason = "is a folder" if out.is_dir() else f"there is no folder {out.parent}"
        raise InputError(f"out={out}: {reason}; name another file")
    if out.exists() and not is_own(out):
        raise InputError(
            f"out={out}: exists, and no {writer} wrote it; name another file with out=FILE{SUFFIX}"
        )
    return out


def write_checkpoint(out: Path, contents: dict) -> None:
    """Write a checkpoint's contents in one step; raise InputError if that fails."""
    buffer = io.BytesIO()
    torch.save(contents, buffer)
    try:
        write_whole(out, buffer.getbuffer())
    except OSError as error:
        raise InputError(f"out={out}: {error.strerror}; name another file") from None
