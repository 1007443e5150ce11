"""Kinds of networks' files: PyTorch's, and those that installed packages describe and read.

A package names a module with the functions of `WeightsReader` as an entry point of the group
`drivezoo.weights`. It is asked where a file is not PyTorch's.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol, runtime_checkable

from zoo.base.bounded_files import open_binary
from zoo.base.entry_points import load_entries
from zoo.base.errors import InputError, file_errors
from zoo.base.limits import open_archive

if TYPE_CHECKING:
    from torch import nn  # the doctor imports this module without packages

GROUP = "drivezoo.weights"
MOST_BYTES = 8_000_000_000
TORCH, SCRIPT, PICKLE = "torch", "script", "pickle"
ZIP = b"PK\3\4"
# Begins of files without a zip: PyTorch's before 1.6, and others' pickles.
BEGINS = {TORCH: rb"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19", PICKLE: rb"\x80[\x02-\x05]"}


@runtime_checkable
class WeightsReader(Protocol):
    """A reader of networks' files: a module with these functions."""

    def describe(self, path: Path) -> str:
        """Return what a file or folder is and what to do with it; empty if it is unknown."""

    def detect(self, path: Path) -> bool:
        """Return whether `load` and `read` take a file."""

    def load(self, network: nn.Module, path: Path) -> str:
        """Load a file's weights into a network in place, and return one line on them.

        Raises:
            InputError: the file is damaged, or does not fit the network.
        """

    def read(self, path: Path) -> nn.Module:
        """Return the network in a file, in evaluation mode.

        Raises:
            InputError: the file is damaged, or its network cannot be built.
        """


def describe_network(path: Path) -> str:
    """Return what a file or folder is and what to do with it; empty if no reader knows it."""
    # Packages first: they know their own files, of which an extra only sees that they are packed.
    readers = reversed([*load_entries(GROUP, WeightsReader)])
    return next(filter(None, (reader.describe(path) for reader in readers)), "")


def weights_reader(path: Path) -> WeightsReader | None:
    """Return the reader of a file; None for PyTorch's, and if nothing installed reads it."""
    with file_errors(path, "{}; name another file"), open_binary(path, MOST_BYTES) as file:
        if torch_kind(file):
            return None
    readers = load_entries(GROUP, WeightsReader)
    return next((reader for reader in readers if reader.detect(path)), None)


def read_network(path: Path) -> nn.Module:
    """Return the network in a file that is not PyTorch's.

    Raises:
        InputError: nothing installed reads the file; or see `WeightsReader.read`.
    """
    reader = weights_reader(path)
    if reader is None:
        raise InputError(
            f"{path}: nothing installed reads this network; install drivezoo again, or a package "
            f"with an entry point {GROUP}"
        )
    return reader.read(path)


def torch_kind(file: BinaryIO) -> str:
    """Return the kind of an opened file if it is PyTorch's or a pickle; empty for all else."""
    file.seek(0)
    begin = file.read(512)
    if not begin.startswith(ZIP):
        return next((kind for kind, form in BEGINS.items() if re.match(form, begin)), "")
    names = archive_names(file, begin)
    if not any(name.endswith("/data.pkl") for name in names):
        return ""
    return SCRIPT if any("/code/" in name for name in names) else TORCH


def archive_names(file: BinaryIO, begin: bytes) -> list[str]:
    """Return the names in a zip; of a damaged one, the first name in its first bytes."""
    try:
        return open_archive(file, "").namelist()
    except Exception:  # zipfile raises any error on damaged bytes
        return [begin[30:][: int.from_bytes(begin[26:28], "little")].decode("latin-1")]


def describe_torch(load: str) -> str:
    """Return what a file of PyTorch is, and the three lines of Python that drive it.

    Args:
        load: statements that set `net`.
    """
    lines = (
        "import drivezoo, torch",
        load,
        "drivezoo.evaluate(lambda frame, mph: (float(net.eval()(torch.tensor(frame).permute(2, 0, "
        "1)[None] / 127.5 - 1).detach()),), track='lake')",
    )
    return (
        "is PyTorch's, whose layers are code; three lines of Python drive it, with its own class, "
        f"and its own input in place of frame / 127.5 - 1: {'; '.join(lines)}"
    )


def describe_script(path: Path) -> str:
    """Return what a network that TorchScript saved is, and what drives it."""
    return describe_torch(f"net = torch.jit.load({str(path)!r})")
