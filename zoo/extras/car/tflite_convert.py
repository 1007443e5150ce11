"""Convert a checkpoint to a file of LiteRT, by TensorFlow or by litert-torch."""

from importlib import import_module
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from torch import Tensor, nn, zeros

from zoo.base.errors import library_errors
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.network_files import read_network
from zoo.extras.car.donkeycar_file import donkeycar_bytes
from zoo.models.layers import Unbin


class DonkeycarModule(nn.Module):
    """The network of a Keras file with Donkeycar's input and outputs.

    Args:
        network: network that `read_network` returned.
    """

    def __init__(self, network: Any) -> None:
        super().__init__()
        self.network, self.units = network, [1] * network.facts.outputs
        if isinstance(network.layers[-1], Unbin):
            self.units = [bins for bins, *_ in network.layers.pop(-1).groups]

    def forward(self, img_in: Tensor) -> tuple[Tensor, ...]:
        """Return steering and throttle, or their bins, for float32 [1, H, W, 3] in 0..1."""
        values = self.network(255 * img_in.permute(0, 3, 1, 2))
        ends = accumulate(self.units)  # litert-torch 0.10.0 fails at `split` of one part
        return tuple(
            values[:, end - count : end] for count, end in zip(self.units, ends, strict=True)
        )


def tflite_bytes(checkpoint: Checkpoint, out: Path, name: str) -> tuple[bytes, str]:
    """Return a checkpoint as a `.tflite` file, and Donkeycar's type of the model.

    Args:
        checkpoint: checkpoint to write.
        out: file that an error names.
        name: converter, `tensorflow` or `litert_torch`.

    Raises:
        InputError: the converter fails, or see `donkeycar_bytes`.
    """
    # litert-converter 0.5.0 refuses the dense layers that resize in a file of Keras 3.
    keras, suffix = (3, ".keras") if name == "tensorflow" else (2, ".h5")
    contents, kind = donkeycar_bytes(checkpoint, keras)
    with (
        TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        library_errors(out, f"{name} cannot convert it", "use another version"),
    ):
        path = Path(folder, "pilot").with_suffix(suffix)
        path.write_bytes(contents)
        converter = import_module(name)
        if name == "tensorflow":
            model = converter.keras.models.load_model(path, compile=False)
            converted = converter.lite.TFLiteConverter.from_keras_model(model).convert()
        else:
            frame = {"img_in": zeros(1, *checkpoint.view.frame, 3)}
            module = DonkeycarModule(read_network(path)).eval()
            converter.convert(module, sample_kwargs=frame).export(f"{path}.tflite")
            converted = Path(f"{path}.tflite").read_bytes()
    return converted, f"tflite_{kind}"
