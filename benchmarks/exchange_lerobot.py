"""Open an export with the real LeRobot, and compare it with the recording.

python benchmarks/exchange_lerobot.py DATASET FOLDER

DATASET is what `drivezoo convert FOLDER to=lerobot out=DATASET` wrote. It runs in an environment of
its own, which has `lerobot` (tried with 0.4.4) and not drivezoo.
"""

import csv
import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import library

# torchvision's wheel is built for CUDA. Without CUDA its operators cannot load; the decoding of
# videos uses none of them, but torchvision wants to describe this one.
operators = library.Library("torchvision", "FRAGMENT")
if not hasattr(torch.ops.torchvision, "nms"):
    operators.define("nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")

from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402

ROWS = 60  # rows whose images are compared


def main(root: str, folder: str) -> None:
    """Print lengths, whether steering is equal, and how far images differ."""
    dataset = LeRobotDataset("local/drivezoo", root=root)
    with (Path(folder) / "driving_log.csv").open() as file:
        log = [row for row in csv.reader(file) if "steering" not in row]
    steering = np.array([float(row[3]) for row in log])
    columns = dataset.hf_dataset.with_format("numpy")
    print(f"{len(dataset)} of {len(log)} rows, {dataset.num_episodes} episodes, {dataset.fps} fps")
    print("steering equal to the bit:", np.array_equal(columns["steering"], steering))
    action = np.array(columns["action"])[:, 0]
    print("action equal as float32:", np.array_equal(action, steering.astype(np.float32)))
    differences, squares = [], []
    for row in range(0, len(log), max(1, len(log) // ROWS)):
        item = dataset[row]
        for camera, written in zip(("center", "left", "right"), log[row], strict=False):
            name = written.strip().replace("\\", "/").rpartition("/")[2]
            old = np.asarray(Image.open(Path(folder) / "IMG" / name)).astype(float)
            new = item[f"observation.images.{camera}"].numpy().transpose(1, 2, 0) * 255
            differences.append(np.abs(new - old).mean())
            squares.append(np.square(new - old).mean())
    print(
        f"{len(differences)} images: mean difference {np.mean(differences):.2f} of 255, at most "
        f"{np.max(differences):.2f}; PSNR {10 * np.log10(255**2 / np.mean(squares)):.1f} dB, at "
        f"least {10 * np.log10(255**2 / np.max(squares)):.1f} dB"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
