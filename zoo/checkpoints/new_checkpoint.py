"""Write a checkpoint that no training wrote, without replacing one of a training."""

import io
from collections.abc import Sequence
from pathlib import Path

import torch

from zoo.base.errors import InputError
from zoo.base.whole_file import write_output
from zoo.base.written_files import check_output

SUFFIX = ".ckpt"


def checked_out(out: Path, inputs: Sequence[str | Path]) -> Path:
    """Return the path to write; refuse to replace a file that drivezoo did not write.

    Args:
        out: path that the user named.
        inputs: files that the command reads.

    Raises:
        InputError: the path has another suffix, its folder does not exist, or see `check_output`.
    """
    if out.suffix != SUFFIX:
        raise InputError(f"out={out}: must end in {SUFFIX}; name such a file")
    if not out.parent.is_dir():
        raise InputError(f"out={out}: there is no folder {out.parent}; name another file")
    check_output(out, inputs=inputs)
    return out


def write_checkpoint(out: Path, contents: dict) -> None:
    """Write a checkpoint's contents in one step; raise InputError if that fails."""
    buffer = io.BytesIO()
    torch.save(contents, buffer)
    write_output(out, buffer.getbuffer())
