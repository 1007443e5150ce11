"""Compare spread and error of policies: `python benchmarks/doubt.py RECORDING CKPT...`.

Prints for each checkpoint, over 300 frames of the centre camera: the mean absolute error of the
steering, the mean spread, the share of frames whose recorded steering lies within 1.96 spreads of
the mean (0.95 for a perfect spread), the rank correlation of spread and absolute error, and the CPU
time of a frame on one thread.
"""

import sys
import time
from pathlib import Path

import numpy as np
import torch
from scipy.stats import spearmanr

from datamodules.image import decode_image
from datamodules.recording import read_recordings
from zoo.checkpoints.policy import load_policy

FRAMES, WARM_UP = 300, 5
ROW = "{:<34} {:>9} {:>9} {:>9} {:>11} {:>9}"


def main(folder: str, checkpoints: list[str]) -> None:
    torch.set_num_threads(1)
    recording = read_recordings(folder)
    rows = np.linspace(0, len(recording) - 1, FRAMES).astype(int)
    frames = [decode_image(Path(path).read_bytes()) for path in recording.images[rows, 0]]
    print(ROW.format("policy", "error", "spread", "within", "correlation", "CPU ms"))
    for checkpoint in checkpoints:
        policy = load_policy(checkpoint)
        for frame in frames[:WARM_UP]:
            policy(frame, 9.0)
        began = time.process_time()
        answers = [
            policy(frame, float(mph))
            for frame, mph in zip(frames, recording.speed_mph[rows], strict=True)
        ]
        took_ms = 1000 * (time.process_time() - began) / FRAMES
        spread = np.array([one.spread for one in answers], float)
        error = np.abs([one.steering for one in answers] - recording.steering[rows])
        figures = (
            f"{error.mean():.3f}",
            f"{spread.mean():.3f}",
            f"{(error <= 1.96 * spread).mean():.2f}",
            f"{spearmanr(spread, error)[0]:.2f}",
            f"{took_ms:.1f}",
        )
        print(ROW.format(policy.name, *figures))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
