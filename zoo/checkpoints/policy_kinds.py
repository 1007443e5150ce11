"""Kinds of torch files that drive, besides checkpoints: those of extras and installed packages.

A package names a kind by the entry point `drivezoo.policies`. The file's contents decide which of
the installed kinds reads it; they never name a module.
"""

from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from zoo.base.entry_points import installed_entries, load_entries
from zoo.checkpoints.policy_base import Policy

GROUP = "drivezoo.policies"


@runtime_checkable
class PolicyKind(Protocol):
    """A kind of file: a module, or an object, with these names.

    Attributes:
        title: the kind in words, such as `file of drivezoo doubt`.
    """

    title: str

    def detect(self, contents: Any) -> bool:
        """Return whether a file has this kind, by its contents: plain containers and tensors."""

    def read(self, contents: Any, path: Path, threads: int, engine: str) -> Policy:
        """Return the policy of a file's contents.

        Args:
            contents: contents of the file.
            path: file, for messages.
            threads: number of onnxruntime's threads.
            engine: engine that runs the networks: torch, onnx, or auto.

        Raises:
            InputError: the contents are damaged, or cannot drive.
        """


def policy_kind(contents: Any) -> PolicyKind | None:
    """Return the installed kind of a file's contents; None if there is none.

    Raises:
        InputError: see `load_entry`.
    """
    return next((kind for kind in load_entries(GROUP, PolicyKind) if kind.detect(contents)), None)


def kind_names() -> str:
    """Return the names of the installed kinds, for messages."""
    return ", ".join(entry.name for entry in installed_entries(GROUP)) or "none"
