"""What one recording of recoveries says of any network, whatever that was trained and tested on.

Laps of the lake that no training has seen, by an expert who is pushed about and comes back: the
same pictures for all networks. Their own test rows differ by split, and by the labels' offset.
"""

import json
import os
from pathlib import Path

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # it asks the network for its own version

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
EVERY = 3  # rows: neighbours are alike
# The labels of the side cameras; networks trained with another offset are compared with it, too.
OFFSET = 0.275
MEASURED = ("mse", "mae", "balanced_mae", "side_mae", "side_response")
FILE = "recoveries.json"


def measure_missing(folders: list[Path], console: Console) -> None:
    """Write `recoveries.json` into each run's folder that has none."""
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
        said = ", ".join(f"{name} {value:.4f}" for name, value in figures.items())
        console.print(f"{folder}: recoveries: {said}", highlight=False)


def figures_of(
    checkpoint: Path, recording: Recording, rows: np.ndarray, frames: list[list[np.ndarray]]
) -> dict[str, float]:
    """Figures of a network on `rows`, whose pictures are `frames` (of centre, left and right).

    `mse`, `mae` and `balanced_mae` of the centre camera; `side_mae` of the side cameras, whose
    steering is the recorded one and `OFFSET`; `side_response` as `zoo.training.open_loop` has it.
    """
    policy = load_policy(str(checkpoint))
    true, speed = recording.steering[rows], recording.speed_mph[rows]
    center, left, right = (
        np.array([policy(*one)[0] for one in zip(pictures, speed, strict=True)])
        for pictures in frames
    )
    figures = open_loop_metrics(center, true)
    sides = np.abs([left - (true + OFFSET), right - (true - OFFSET)])
    figures |= {
        "side_mae": float(sides.mean()),
        "side_response": side_response(left, right),
    }
    return {name: figures[name] for name in MEASURED}
