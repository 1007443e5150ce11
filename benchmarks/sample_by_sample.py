"""The usual data set, as a reference: it decodes, resizes and augments each drawn sample."""

from pathlib import Path

import albumentations
import cv2
import numpy as np
import torch
from torch.utils.data import Dataset

from datamodules.driving import DrivingData


class SampleBySample(Dataset):
    """The samples of `DrivingData`, one at a time, by OpenCV and albumentations."""

    def __init__(self, data: DrivingData) -> None:
        self.samples, self.images, self.view = data.samples, data.recording.images, data.view
        # The same transforms, as albumentations runs them.
        transforms = [change.transform for change in data.augment.changes]
        self.augment = albumentations.Compose(transforms)
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
        changed = self.augment(image=image, steering=steering)
        return {
            "images": torch.from_numpy(changed["image"]).permute(2, 0, 1).contiguous(),
            "targets": torch.tensor([changed["steering"]], dtype=torch.float32),
        }
