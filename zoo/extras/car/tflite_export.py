"""The kind of `drivezoo export` that LiteRT runs, such as on a Raspberry Pi."""

from functools import cached_property
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from zoo.base.errors import library_errors
from zoo.extras.car.donkeycar_export import KerasFile

# torch, a slow import, comes late: --help and typos answer at once.
if TYPE_CHECKING:
    from zoo.checkpoints.frame_memory import SessionPolicy


class TfliteFile(KerasFile):
    """A checkpoint as a file of LiteRT (TensorFlow Lite), by TensorFlow's converter."""

    default = "pilot.tflite"
    packages = ("h5py", "tensorflow")
    install = "pip install h5py tensorflow, or write pilot.keras and convert it on another machine"
    engine = "LiteRT"
    not_run = "nothing here runs it: pip install ai-edge-litert"

    @cached_property
    def _written(self) -> tuple[bytes, str]:
        from zoo.extras.car.donkeycar_file import donkeycar_bytes

        tensorflow = import_module("tensorflow")  # optional, checked before
        contents, kind = donkeycar_bytes(self.checkpoint, self.keras)
        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            path = Path(folder, KerasFile.default)
            path.write_bytes(contents)
            with library_errors(self.out, "TensorFlow cannot convert it", "use another version"):
                model = tensorflow.keras.models.load_model(path, compile=False)
                converter = tensorflow.lite.TFLiteConverter.from_keras_model(model)
                return converter.convert(), f"tflite_{kind}"

    def policy(self, path: Path) -> "SessionPolicy | None":
        """Return the policy of the file; None where no LiteRT is installed."""
        from zoo.extras.car.tflite_policy import TflitePolicy, find_interpreter

        return TflitePolicy(self.checkpoint, path) if find_interpreter() else None
