"""`drivezoo export`: write a checkpoint as an ONNX file."""

from pathlib import Path

from rich.console import Console

from zoo.base.command import command


@command
def export(ckpt: str, *, out: str = "model.onnx", frames: str | None = None) -> Path:
    """Write a checkpoint as an ONNX file, or for Donkeycar.

    Every command that drives takes the file in place of the checkpoint; its metadata has view and
    config. If its steering (-1..1) differs from the checkpoint's by more than 0.0001, writes
    nothing.

    Args:
        ckpt: checkpoint: a .ckpt file, a run's folder, or latest.
        out: file to write: .onnx, or .h5 for Donkeycar's manage.py drive --model; an existing one
            is replaced only after the comparison.
        frames: recording whose frames are compared; null: the training's recording, else the
            embedded lake's, else new frames of the embedded lake.

    Raises:
        InputError: the checkpoint or recording does not exist, a package is not installed, the
            file cannot be written, or it steers differently from the checkpoint.
    """
    from zoo.export.onnx_file import export_checkpoint

    return export_checkpoint(ckpt, out, frames, Console())


if __name__ == "__main__":
    export.run()
