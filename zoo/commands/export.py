"""`drivezoo export`: write a checkpoint as an ONNX file, for Donkeycar, or as C."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from rich.console import Console

from zoo.base.command import command


@command(outputs=True)
def export(
    ckpt: str,
    *,
    to: str | None = None,
    out: str | None = None,
    weights: Literal["float", "int8"] = "float",
    calibration: str | None = None,
    frames: str | None = None,
    throttle: Annotated[float, Field(gt=0, le=1)] | None = None,
) -> Path:
    """Write a checkpoint as an ONNX file, for Donkeycar, or as C.

    Every command that drives takes an ONNX file in place of the checkpoint. A C file holds view and
    network, and needs no library. If the steering (-1..1) of the file differs from the checkpoint's
    by more than 0.0001 (0.02 if Keras computes the view, 0.1 for 8 bits), writes nothing.

      drivezoo export latest out=model.onnx
      drivezoo export latest to=c out=steer.c weights=int8
      drivezoo export latest to=onnx weights=int8 calibration=RECORDING
      drivezoo export latest to=donkeycar throttle=0.2

    `drivezoo export doubt CKPT...` makes one checkpoint of several, which also returns its spread;
    see drivezoo doubt --help.

    Args:
        ckpt: checkpoint: a .ckpt file, a run's folder, or latest.
        to: onnx; for Donkeycar's manage.py drive --model: donkeycar (Keras 2), keras (Keras 3, from
            Donkeycar 5.4 on), tflite; c: a C99 file and its header; null: by the ending of out.
        out: file to write: .onnx, .h5, .keras or .tflite for Donkeycar, .c, with the name of the C
            function; null: model.onnx, pilot.h5 or steer.c.
        weights: int8: c and onnx: a quarter of the size; the steering changes a little, which is
            printed.
        calibration: recording whose frames give the ranges of values of weights=int8 in an ONNX
            file; null: those of frames=null.
        frames: recording whose frames are compared; null: the training's recording, else the
            embedded lake's, else new frames of the embedded lake, in the size of the training's.
        throttle: for Donkeycar: largest throttle, and the only one of a network that only steers;
            null: the network's, or what Donkeycar computes from the steering, 0.56 to 1.

    Raises:
        InputError: the checkpoint or recording does not exist, a package is not installed, the
            file cannot be written, or it steers differently from the checkpoint.
        UsageError: the ending does not fit, or weights=int8 for another kind.
    """
    from zoo.scoring.checked_export import export_checkpoint

    return export_checkpoint(ckpt, out, frames, Console(), to, weights, calibration, throttle)


if __name__ == "__main__":
    export.run()
