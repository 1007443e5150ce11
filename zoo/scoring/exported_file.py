"""The contract of a file that a checkpoint is exported to, and the one door to all its kinds.

drivezoo's own kind is ONNX. An extra or another installed package names further ones as entry
points of `drivezoo.exports`: `NAME` is `to=NAME`, and `NAME.int8` is `to=NAME weights=int8`.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.entry_points import load_entry, named_entries
from zoo.checkpoints.onnx_policy import INSTALL, SUFFIX, TOLERANCE, OnnxPolicy

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.checkpoints.frame_memory import SessionPolicy
    from zoo.scoring.parity import Frames

GROUP = "drivezoo.exports"  # entry points of extras and other installed packages
FLOAT = "float"  # usual type of the weights


class ExportedFile:
    """A checkpoint as a file of one kind; a subclass defines the kind.

    A module of a kind imports slow libraries in its methods, since it is imported to read its
    attributes.

    Args:
        checkpoint: checkpoint to write.
        out: file to write.
        calibration: recording whose frames give the ranges of values of 8 bits; None for the
            training's.
        throttle: largest throttle that the file returns; None for no bound.

    Attributes:
        default: name of the file if the user names none; its ending is that of the kind.
        beside: endings of further files with the same name.
        packages: packages that write it.
        install: command that installs them.
        keys: those of `calibration` and `throttle` that the kind takes.
        drives: whether drivezoo's commands take the file in place of the checkpoint.
        engine: what runs the file.
        not_run: why the file was not run, where `policy` returns None.
        tolerance: largest allowed difference from the checkpoint.
        remedy: what to do after a larger difference.
    """

    default: str
    beside: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    install = INSTALL
    keys: tuple[str, ...] = ()
    drives = False
    engine: str
    not_run = "nothing here runs it"
    tolerance = TOLERANCE
    remedy = "name another kind of file, such as out=model.onnx"

    def __init__(
        self,
        checkpoint: "Checkpoint",
        out: Path,
        calibration: str | None = None,
        throttle: float | None = None,
    ) -> None:
        self.checkpoint, self.out = checkpoint, out
        self.calibration, self.throttle = calibration, throttle

    @classmethod
    def check_name(cls, out: Path) -> None:
        """Raise UsageError for a name that a file of this kind cannot have."""

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return the contents of its files by the endings of their names.

        Args:
            model_card: text for people on the network and the file, in Markdown.

        Raises:
            InputError: the kind cannot hold the network or its view.
        """
        raise NotImplementedError

    def policy(self, path: Path) -> "SessionPolicy | None":
        """Return the policy of a written file; None if no program here can run it."""
        raise NotImplementedError

    def shown(self, frames: "Frames") -> "Frames":
        """Return frames as the file's policy takes them."""
        return frames

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return sentences on what differs from the checkpoint, for its card."""
        return []

    def hints(self) -> list[str]:
        """Return lines on how to use it."""
        return []


class OnnxFile(ExportedFile):
    """A checkpoint as an ONNX file."""

    default = f"model{SUFFIX}"
    packages = ("onnx", "onnxruntime")
    drives = True
    engine = "onnxruntime"
    remedy = "try another version of onnxruntime"
    graph = b""

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return the file, see `ExportedFile`."""
        from zoo.checkpoints.onnx_file import onnx_bytes

        return {SUFFIX: onnx_bytes(self.checkpoint, model_card, self.graph)}

    def policy(self, path: Path) -> OnnxPolicy:
        """Return the policy, see `ExportedFile`."""
        return OnnxPolicy(path)


OWN: dict[str, type[ExportedFile]] = {"onnx": OnnxFile}


def export_names() -> list[str]:
    """Return the names of all kinds, as in `to=NAME`; nothing is imported."""
    return [name for name in {**OWN, **named_entries(GROUP)} if "." not in name]


def exports(
    to: str | None = None, weights: str = FLOAT
) -> Iterator[tuple[str, type[ExportedFile]]]:
    """Yield the name and the class of each kind, those of installed packages last.

    Args:
        to: name of the only kind to yield; None for all.
        weights: type of the weights in the file.

    Raises:
        InputError: a kind of a package cannot be imported.
    """
    entries = named_entries(GROUP, OWN).values()
    if weights == FLOAT:
        yield from (pair for pair in OWN.items() if to in (None, pair[0]))
    for entry in entries:
        name, _, its = entry.name.partition(".")
        if to in (None, name) and weights == (its or FLOAT):
            yield name, load_entry(entry, ExportedFile)
