"""Compare our feeding with that of a DataLoader: `make bench ONLY=feed`."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import albumentations
import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

from benchmarks.material import AUGMENT, config_for, linked_recording, loaded_data
from benchmarks.measuring import Row, compared, take_turns
from datamodules.driving import DrivingData
from zoo.training.host_settings import keep_freed_memory

BATCH = 64


def measure(short: bool) -> list[Row]:
    """Measure batches of nvidia's view with flips, brightness, shadow and shift."""
    rows, batches, rounds = (120, 1, 1) if short else (2_000, 8, 5)
    words = AUGMENT, f"data.batch_size={BATCH}"
    data = loaded_data(config_for(linked_recording(rows), *words))
    loader = DataLoader(SampleBySample(data), batch_size=BATCH, shuffle=True)
    keep_freed_memory()  # as a run does
    measures = {
        "ours/s": rate(endless(data.train_dataloader()), 8 * batches),
        "sample by sample/s": rate(endless(loader), batches),
    }
    take_turns(measures, 1)  # warms up memory pages and thread pools
    speeds = take_turns(measures, rounds)
    what = "feeding, 66 x 200, flip, brightness, shift, shadow"
    one_by_one = "decoded, resized, augmented one by one"
    return [compared(speeds, what, one_by_one, ("ours/s", "sample by sample/s"), 10.0)]


class SampleBySample(Dataset):
    """The samples of `DrivingData`, one at a time, by OpenCV and albumentations."""

    def __init__(self, data: DrivingData) -> None:
        self.samples, self.images, self.view = data.samples, data.recording.images, data.view
        # What a user of albumentations writes for the same augmentations.
        brightness = albumentations.RandomBrightnessContrast(contrast_limit=0, p=1.0)
        shift = albumentations.Affine(translate_px={"x": (-25, 25), "y": (0, 0)}, p=0.5)
        shadow = albumentations.RandomShadow(p=0.3)
        self.augment = albumentations.Compose([brightness, shadow, shift])
        self.rng = np.random.default_rng(0)

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        samples = self.samples
        path = Path(self.images[samples.row[index], samples.camera[index]])
        frame = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        image, steering = self.view(frame), float(samples.steering[index])
        if self.rng.random() < 0.5:
            image, steering = np.ascontiguousarray(image[:, ::-1]), -steering
        changed = self.augment(image=image)["image"]
        return {
            "images": torch.from_numpy(changed).permute(2, 0, 1).contiguous(),
            "targets": torch.tensor([steering], dtype=torch.float32),
        }


def endless(loader: DataLoader) -> Iterator[dict]:
    """Yield batches epoch after epoch."""
    while True:
        yield from loader


def rate(feed: Iterator[dict], batches: int) -> Callable[[], float]:
    """Return a function that measures frames per second over the next batches."""

    def run() -> float:
        began = time.perf_counter()
        count = sum(len(next(feed)["images"]) for _ in range(batches))
        return count / (time.perf_counter() - began)

    return run
