"""`drivezoo saliency CKPT IMAGE_OR_RECORDING [key=value ...]`: draw what a network looks at.

Writes a PNG file: one image, or twelve frames of a recording, each with its saliency to the right.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from datamodules.image import read_image
from datamodules.recording import read_recordings
from zoo.base.errors import InputError
from zoo.base.whole_file import write_output
from zoo.base.written_files import check_output
from zoo.checkpoints.checkpoint_path import find_checkpoint, short_name
from zoo.cli.closing_lines import print_written
from zoo.cli.command import CHECKPOINT, Command
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command

COMMAND = Command(
    __doc__, {"CKPT": CHECKPOINT, "IMAGE_OR_RECORDING": "JPEG or PNG, or a recording's folder"}
)
SHOWN = 12  # frames of a recording that are drawn

# torch, a slow import, comes late: --help and typos answer at once.


@dataclass(frozen=True, kw_only=True)
class SaliencyOptions:
    """Options of a saliency image; `conf/saliency.yaml` has their meanings and defaults."""

    out: str
    published: bool


def draw_saliency(arguments: list[str]) -> None:
    """Write a PNG file of frames, each with the network's saliency to the right."""
    (checkpoint, source), options = COMMAND.read(arguments, SaliencyOptions)
    checkpoint = find_checkpoint(checkpoint)
    out = Path(options.out).expanduser()
    check_output(out, inputs=[checkpoint, Path(source).expanduser()])
    with loading():
        from zoo.checkpoints.policy import load_policy
        from zoo.saliency.visual_backprop import Saliency, overlay

        saliency = Saliency(load_policy(checkpoint), options.published)
        pairs = [
            np.hstack([frame, overlay(frame, saliency(frame, speed))])
            for frame, speed in _frames(Path(source).expanduser())
        ]
    columns = 1 if len(pairs) < 3 else 2
    pairs += [np.zeros_like(pairs[0])] * (-len(pairs) % columns)
    rows = [np.hstack(pairs[start : start + columns]) for start in range(0, len(pairs), columns)]
    write_output(out, cv2.imencode(".png", np.vstack(rows)[:, :, ::-1])[1].tobytes())
    print_written([out], ["drive", short_name(checkpoint), "sim=lake"])


def _frames(source: Path) -> list[tuple[np.ndarray, float]]:
    """Return frames with their speed in mph: one image, or `SHOWN` rows across a recording."""
    if source.is_file() and source.suffix != ".csv":
        return [(_read_frame(source), 0.0)]
    recording = read_recordings(str(source), on_bad_image="skip")
    rows = np.unique(np.linspace(0, len(recording) - 1, SHOWN).round().astype(int))
    return [(_read_frame(Path(recording.images[r, 0])), recording.speed_mph[r]) for r in rows]


def _read_frame(path: Path) -> np.ndarray:
    try:
        return read_image(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}; name a JPEG or PNG, or a recording's folder") from None


if __name__ == "__main__":
    sys.exit(run_command("zoo.saliency", draw_saliency, sys.argv[1:]))
