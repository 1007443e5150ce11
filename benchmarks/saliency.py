"""Compare saliency with greyed-out patches: `python benchmarks/saliency.py CKPT RECORDING`.

In each frame, patches of 20 x 20 pixels, 10 pixels apart, get their mean colour one by one, and
change the steering. The script prints the mean rank correlation between these changes and the
saliency at the same places, within the network's view.
"""

import sys

import cv2
import numpy as np
from scipy.stats import spearmanr

from datamodules.image import decode_image
from datamodules.recording import read_recordings
from zoo.checkpoints.policy import Policy, load_policy
from zoo.saliency.visual_backprop import Saliency

FRAMES, PATCH, STEP = 11, 20, 10


def steering_changes(policy: Policy, frame: np.ndarray) -> np.ndarray:
    """Return float64 [16, 32]: the change of steering when the patch at a place is grey."""
    steering = policy(frame, 9.0)[0]
    changes = np.zeros((frame.shape[0] // STEP, frame.shape[1] // STEP))
    for row, column in np.ndindex(*changes.shape):
        top, left = row * STEP - STEP // 2, column * STEP - STEP // 2
        patch = np.s_[max(top, 0) : top + PATCH, max(left, 0) : left + PATCH]
        greyed = frame.copy()
        greyed[patch] = frame[patch].mean((0, 1))
        changes[row, column] = abs(policy(greyed, 9.0)[0] - steering)
    return changes


def main(checkpoint: str, folder: str) -> None:
    policy, recording = load_policy(checkpoint), read_recordings(folder)
    rows = np.linspace(0, len(recording) - 1, FRAMES + 2).astype(int)[1:-1]
    paths = recording.images[rows, 0]
    frames = [decode_image(open(path, "rb").read()) for path in paths]  # noqa: SIM115, PTH123
    truth = [steering_changes(policy, frame) for frame in frames]
    top, bottom = policy.view.crop
    seen = np.s_[-(-top // STEP) : (160 - bottom) // STEP]
    for name, published in (("gradient-weighted", False), ("as published", True)):
        saliency = Saliency(policy, published)
        ranks = []
        for frame, changes in zip(frames, truth, strict=True):
            where = cv2.resize(
                saliency(frame, 9.0), changes.shape[::-1], interpolation=cv2.INTER_AREA
            )
            ranks.append(spearmanr(where[seen].ravel(), changes[seen].ravel())[0])
        print(f"{name}: {np.mean(ranks):.2f} (over {len(ranks)} frames, sd {np.std(ranks):.2f})")


if __name__ == "__main__":
    main(*sys.argv[1:])
