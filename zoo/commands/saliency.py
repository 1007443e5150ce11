"""`drivezoo saliency`: draw what a network looks at."""

from pathlib import Path

import cv2
import numpy as np

from datamodules.format_options import ReadOptions
from datamodules.image import AnyImage, read_image
from datamodules.recording_format import read_recordings
from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.base.errors import InputError
from zoo.base.output_files import checked_file
from zoo.base.terminal import print_written
from zoo.base.whole_file import write_output
from zoo.checkpoints.checkpoint_path import find_checkpoint, short_name
from zoo.checkpoints.policy_base import read_as_trained

SHOWN = 12  # frames of a recording that are drawn
CAPTION = 24  # height in pixels of the line below a pair

# torch, a slow import, comes late: --help and typos answer at once.


@command(outputs=True)
def saliency(
    ckpt: str,
    image_or_recording: str,
    *,
    read: ReadOptions,
    out: str = "saliency.png",
    published: bool = False,
) -> None:
    """Draw what a network looks at.

    Writes a PNG file: one image, or twelve frames of a recording, each with its saliency to the
    right and a line below that names it.

    Args:
        ckpt: checkpoint: a .ckpt file, a run's folder, latest, or a network that comes with
            drivezoo, such as lenet.
        image_or_recording: JPEG or PNG, or a recording's folder.
        read: see `ReadOptions`; not given: as in the training, if it trained on this recording.
        out: PNG file to write.
        published: true: VisualBackProp to the letter; false: weighted by the effect on the
            steering.
    """
    checkpoint, source = find_checkpoint(ckpt), Path(image_or_recording).expanduser()
    image = checked_file(out, (".png",), inputs=[checkpoint, source])
    with loading():
        from zoo.checkpoints.checkpoint_policy import load_policy
        from zoo.scoring.visual_backprop import Saliency, overlay

        policy = load_policy(checkpoint)
        look = Saliency(policy, published)
        frames = _frames(source, read_as_trained([policy], source, read))
        height, width = frames[0][0].shape[:2]
        pairs = []
        for frame, speed, caption in frames:
            pair = np.hstack([frame, overlay(frame, look(frame, speed))])
            # A recording may have images of two sizes; those drawn together need one.
            pairs.append(_captioned(cv2.resize(pair, (2 * width, height)), caption))
    columns = 1 if len(pairs) < 3 else 2
    pairs += [np.zeros_like(pairs[0])] * (-len(pairs) % columns)
    rows = [np.hstack(pairs[start : start + columns]) for start in range(0, len(pairs), columns)]
    write_output(image, cv2.imencode(".png", np.vstack(rows)[:, :, ::-1])[1].tobytes())
    # The embedded tracks show another car than a recording whose facts name a source.
    following = [] if policy.data.get("source") else ["drive", short_name(checkpoint), "sim=lake"]
    print_written([image], following)


def _captioned(pair: np.ndarray, caption: str) -> np.ndarray:
    line = np.full((CAPTION, pair.shape[1], 3), 255, np.uint8)
    style = cv2.FONT_HERSHEY_SIMPLEX, 0.45, (40, 40, 40), 1, cv2.LINE_AA
    return np.vstack([pair, cv2.putText(line, caption, (6, CAPTION - 8), *style)])


def _frames(source: Path, said: dict) -> list[tuple[np.ndarray, float, str]]:
    """Return frames, speeds in mph and names: one image, or `SHOWN` rows across a recording."""
    if source.is_file() and source.suffix != ".csv" and "format" not in said:
        return [(_read_frame(source), 0.0, f"{source.name}; right: what the steering depends on")]
    recording = read_recordings(str(source), **said | {"on_bad_image": "skip"})
    return [
        (
            _read_frame(recording.images[row, 0]),
            recording.speed_mph[row],
            f"row {row + 1}, recorded steering {round(recording.steering[row], 2) + 0.0:+.2f}",
        )
        for row in np.unique(np.linspace(0, len(recording) - 1, SHOWN).round().astype(int))
    ]


def _read_frame(path: AnyImage) -> np.ndarray:
    try:
        return read_image(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: {error}; name a JPEG or PNG, or a recording's folder") from None


if __name__ == "__main__":
    saliency.run()
