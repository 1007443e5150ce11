"""Open-loop metrics of networks on one recording of recoveries, the same for all of them.

An expert that sways off its line and returns drives laps of the lake, which no training uses. The
networks' own test rows differ by split and by the offset of the labels, so they cannot be compared.
"""

import json
import os
from pathlib import Path

os.environ.setdefault(
    "NO_ALBUMENTATIONS_UPDATE", "1"
)  # it would look for its newest version online

import numpy as np
from omegaconf import OmegaConf
from rich.console import Console

from datamodules.image import decode_image
from datamodules.recording import Recording, read_recordings
from zoo.checkpoints.policy import load_policy
from zoo.training.embedded_recording import with_recording
from zoo.training.open_loop import open_loop_metrics, side_response

RECORD = {
    "out": "outputs/recordings/recoveries",
    "passes": [{"track": "lake", "direction": "both", "laps": 1, "noise": 1.0, "seed": 9}],
}
EVERY = 3  # every third row, because neighbours are alike
# Offset of the side cameras' labels, also for networks trained with another one.
OFFSET = 0.275
MEASURED = ("mse", "mae", "balanced_mae", "side_mae", "side_response")
FILE = "recoveries.json"


def measure_missing(folders: list[Path], console: Console) -> None:
    """Write `recoveries.json` into each run's folder without one."""
    missing = [folder for folder in folders if not (folder / FILE).is_file()]
    if not missing:
        return
    with_recording(OmegaConf.create({"data": {"root": None, "record": RECORD}}), console)
    recording = read_recordings(RECORD["out"], None, "fail")
    rows = np.arange(0, len(recording), EVERY)
    frames = [
        [decode_image(Path(path).read_bytes()) for path in recording.images[rows, camera]]
        for camera in range(3)
    ]
    for folder in missing:
        figures = figures_of(folder / "checkpoints" / "best.ckpt", recording, rows, frames)
        (folder / FILE).write_text(json.dumps(figures, indent=2))
        shown = ", ".join(f"{name} {value:.4f}" for name, value in figures.items())
        console.print(f"{folder}: recoveries: {shown}", highlight=False)


def figures_of(
    checkpoint: Path, recording: Recording, rows: np.ndarray, frames: list[list[np.ndarray]]
) -> dict[str, float]:
    """Return the figures of a network on `rows` with `frames` of centre, left and right camera.

    `mse`, `mae` and `balanced_mae` are of the centre camera. `side_mae` is of the side cameras,
    with the recorded steering corrected by `OFFSET` as label. `side_response` is that of
    `zoo.training.open_loop`.
    """
    policy = load_policy(str(checkpoint))
    true, speed = recording.steering[rows], recording.speed_mph[rows]
    center, left, right = (
        np.array([policy(*one)[0] for one in zip(images, speed, strict=True)]) for images in frames
    )
    figures = open_loop_metrics(center, true)
    sides = np.abs([left - (true + OFFSET), right - (true - OFFSET)])
    figures |= {
        "side_mae": float(sides.mean()),
        "side_response": side_response(left, right),
    }
    return {name: figures[name] for name in MEASURED}
