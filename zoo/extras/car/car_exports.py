"""Kinds of `drivezoo export` for a small computer: C, and weights of 8 bits."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.errors import InputError
from zoo.extras.car.donkeycar_export import SizedFile
from zoo.scoring.exported_file import FLOAT, OnnxFile

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.checkpoints.frame_memory import SessionPolicy
    from zoo.scoring.parity import Frames

# The largest difference of a network whose values have 8 bits.
INT8_TOLERANCE = 0.1
HEADER = ".h"


class Int8OnnxFile(OnnxFile):
    """A checkpoint as an ONNX file of 8 bits."""

    keys = ("calibration",)
    tolerance = INT8_TOLERANCE
    remedy = "name frames of more places, calibration=RECORDING, or leave weights=int8 out"

    @cached_property
    def graph(self) -> bytes:  # type: ignore[override]
        """Return the graph of 8 bits."""
        from zoo.extras.car.int8_onnx import int8_graph
        from zoo.scoring.parity import CALIBRATION, take_frames

        frames = take_frames(self.calibration, self.checkpoint, CALIBRATION)
        return int8_graph(self.checkpoint, frames)

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return that it has 8 bits, see `ExportedFile`."""
        return ["Weights, and values between the layers: 8 bits."]


class CFile(SizedFile):
    """A checkpoint as a C99 file and its header."""

    default = "steer.c"
    beside = (HEADER,)
    packages = ("onnx",)
    engine = "the compiled file"
    not_run = "no C compiler is installed here"
    weights = FLOAT

    @classmethod
    def check_name(cls, out: Path) -> None:
        """Check the function's name, see `ExportedFile`."""
        from zoo.extras.car.c_source import function_name

        function_name(out)

    def files(self, model_card: str) -> Mapping[str, bytes]:
        """Return both files, see `ExportedFile`."""
        from zoo.extras.car.c_file import c_header

        header = c_header(self.checkpoint, self.out.stem, model_card)
        return {HEADER: header.encode(), self.out.suffix: self._source.encode()}

    @cached_property
    def _source(self) -> str:
        from zoo.extras.car.c_file import c_source

        return c_source(self.checkpoint, self.out.stem, self.weights)

    def policy(self, path: Path) -> "SessionPolicy | None":
        """Return the policy of the compiled file, see `ExportedFile`."""
        from zoo.extras.car.compiled_policy import CompiledPolicy, find_compiler

        return CompiledPolicy(self.checkpoint, path) if find_compiler() else None

    def hints(self) -> list[str]:
        """Return how to call it, see `ExportedFile`."""
        rows, columns = self.checkpoint.view.frame
        return [
            f'in C: #include "{self.out.with_suffix(HEADER).name}", compile {self.out.name} with '
            f"-std=c99 -O2, and call {self.out.stem}(rgb, {columns}, {rows}, speed_mph)"
        ]


class Int8CFile(CFile):
    """A checkpoint as a C99 file with weights of 8 bits."""

    weights = "int8"
    tolerance = INT8_TOLERANCE
    remedy = "leave weights=int8 out, or name another kind of file, such as out=model.onnx"

    def changes(self, original: "Checkpoint", frames: "Frames") -> list[str]:
        """Return what the rounding changes, see `ExportedFile`.

        Raises:
            InputError: it changes the steering too much, compiler or not.
        """
        from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
        from zoo.extras.car.c_file import rounded
        from zoo.scoring.parity import compare

        lost = compare(CheckpointPolicy(original), CheckpointPolicy(rounded(original)), frames)
        if lost.difference > self.tolerance:
            raise InputError(
                f"{self.out}: 8 bits change the steering by {lost.difference:.2g}, more than "
                f"{self.tolerance:g}; nothing was written: {self.remedy}"
            )
        return [
            f"Weights: 8 bits; they change the steering by {lost.difference:.1e} at most, by "
            f"{lost.mean:.1e} on average, over {len(frames.frames)} frames."
        ]
