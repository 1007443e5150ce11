"""The kind of `drivezoo export` that LiteRT runs, such as on a Raspberry Pi."""

from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.extras.car.donkeycar_export import KerasFile

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.checkpoints.frame_memory import SessionPolicy

CONVERTERS = ("tensorflow", "litert_torch")


class TfliteFile(KerasFile):
    """A checkpoint as a file of LiteRT (TensorFlow Lite)."""

    default = "pilot.tflite"
    packages = ("h5py", next(filter(find_spec, CONVERTERS), CONVERTERS[0]))
    install = (
        'pip install h5py tensorflow, or "drivezoo[tflite]" (Linux on x86-64, macOS on ARM); or '
        "write pilot.keras and convert it on another machine"
    )
    engine = "LiteRT"
    not_run = "nothing here runs it: pip install ai-edge-litert"

    @cached_property
    def _written(self) -> tuple[bytes, str]:
        from zoo.extras.car.tflite_convert import tflite_bytes

        return tflite_bytes(self.checkpoint, self.out, self.packages[-1])

    def policy(self, path: Path) -> "SessionPolicy | None":
        """Return the policy of the file; None where no LiteRT is installed."""
        from zoo.extras.car.tflite_policy import TflitePolicy, find_interpreter

        return TflitePolicy(self.checkpoint, path) if find_interpreter() else None
