"""The augmentations of a batch, on the CPU in place or on the device that trains."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
from torch import Tensor

from datamodules.augment import Change
from datamodules.device_augment import from_rgb, to_rgb
from datamodules.view import CODES
from zoo.base.errors import InputError
from zoo.base.rig import STEERING, SteeringLabel

if TYPE_CHECKING:
    import albumentations  # slow import, which most trainings do without

Place = tuple[int, int]  # first index of a shard in its batch, and the batch's size


class Augment:
    """A sequence of augmentations for images of one colour.

    They apply to RGB: a `bgr`, `yuv`, `yuv_old` or `hsv` image is converted to RGB and back.
    Changes of light are left out for saturation (`hsv_s`).

    Args:
        transforms: changes of ours, and transforms of albumentations.
        colour: colour of the view.
        label: what the steering means. A curvature gets that of the steering by which a change
            corrects its car.

    Attributes:
        cpu_only: names of the transforms that a device does not have.
    """

    def __init__(
        self,
        transforms: list["Change | albumentations.BasicTransform"],
        colour: str,
        label: SteeringLabel = STEERING,
    ) -> None:
        if colour == "hsv_s":
            transforms = [
                transform for transform in transforms if not getattr(transform, "lighting", False)
            ]
        self.transforms, self.colour, self.label = transforms, colour, label
        self.cpu_only = [
            type(transform).__name__
            for transform in transforms
            if not isinstance(transform, Change)
        ]
        self._composed = [
            None if isinstance(transform, Change) else _composed(transform)
            for transform in transforms
        ]

    def __call__(
        self, images: np.ndarray, steering: np.ndarray, seed: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return uint8 [N, H, W, C] images and float32 [N] steering, changed by `seed`."""
        changed, corrected = images.copy(), steering.copy()
        self.in_place(changed, corrected, seed)
        return changed, corrected

    def in_place(
        self, images: np.ndarray, steering: np.ndarray, seed: int, place: Place | None = None
    ) -> None:
        """Change images and steering in place; all of a window's images and steering alike.

        Args:
            images: images, uint8 [n, H, W, C]; of windows, [n, sequence, H, W, C].
            steering: steering, float32 [n]; of windows, [n, sequence + ahead].
            seed: random seed of the batch.
            place: first index of a shard in its batch, and the batch's size; a shard is changed
                exactly as within the whole batch. None for a whole batch.
        """
        if not self.transforms or not len(images):
            return
        place = place or (0, len(images))
        from_rgb_code, to_rgb_code = CODES.get(self.colour, (None, None))
        if images.ndim == 4:
            images, steering = images[:, None], steering[:, None]
        if to_rgb_code is not None:
            _convert(images, to_rgb_code)
        streams = self._streams(seed)
        for transform, compose, rng in zip(self.transforms, self._composed, streams, strict=True):
            if compose is None or isinstance(transform, Change):
                chosen, drawn = _draw(transform, images.shape[2:], len(images), rng, place)
                # One thread: with several, Python's lock lets only one run between OpenCV's calls.
                for frames, values in zip(chosen.tolist(), drawn, strict=True):
                    for image in images[frames]:
                        transform.change_one(image, values)
                steering[chosen] = self._corrected(transform, steering[chosen], drawn)
                continue
            first, whole = place
            seeds = rng.integers(2**31, size=whole)[first : first + len(images)]
            for window, window_seed in zip(images, seeds.tolist(), strict=True):
                for image in window:
                    transform.set_random_seed(window_seed)  # the same draws for the whole window
                    changed = np.asarray(compose(image=image)["image"])
                    if (*changed.shape, 1)[:3] != image.shape or changed.dtype != image.dtype:
                        name, shape = type(transform).__name__, [*image.shape]
                        raise InputError(f"augment: {name} must return uint8 {shape}; correct it")
                    image[:] = changed.reshape(image.shape)
        if from_rgb_code is not None:
            _convert(images, from_rgb_code)

    def draw(
        self,
        shape: tuple[int, ...],
        steering: np.ndarray,
        seed: int,
        place: Place | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what `on_device` needs for images of a `shape`, and the corrected steering.

        The draws are those of `in_place`, float32 [n, columns]: of each change whether a sample is
        changed, and its values.
        """
        count = len(steering)
        place, columns = place or (0, count), list[np.ndarray]()
        corrected = steering.reshape(count, -1).copy()
        for change, rng in zip(self.transforms, self._streams(seed), strict=True):
            chosen, values = _draw(change, shape, count, rng, place)
            columns.append(np.zeros((count, 1 + values.shape[1]), np.float32))
            columns[-1][chosen] = np.insert(values, 0, 1, axis=1)
            corrected[chosen] = self._corrected(change, corrected[chosen], values)
        drawn = np.concatenate([np.empty((count, 0), np.float32), *columns], 1)
        return drawn, corrected.reshape(steering.shape)

    def on_device(self, images: Tensor, drawn: Tensor) -> Tensor:
        """Return images on a device changed as by `in_place`, but for rounding.

        It takes the same operations on the same shapes for every batch of a size: what a GPU waits
        for is the program that starts them, not their size.

        Args:
            images: images, uint8 [n, H, W, C]; of windows, [n, sequence, H, W, C].
            drawn: values of `draw`, float32 [n, columns].
        """
        if not self.transforms or not len(images):
            return images
        shape, sequence = images.shape[-3:], images.shape[:-3].numel() // len(images)
        changed = to_rgb(images.reshape(-1, *shape).permute(0, 3, 1, 2).float(), self.colour)
        each, rng = drawn.repeat_interleave(sequence, 0), np.random.default_rng(0)
        widths = [1 + change.draw((0, *shape), rng).shape[1] for change in self.transforms]
        for change, columns in zip(self.transforms, each.split(widths, 1), strict=True):
            before, changed = changed, change.change_all(changed, columns[:, 1:])
            if not change.zeros_change_nothing and change.p < 1:
                changed = torch.where(columns[:, 0, None, None, None] > 0, changed, before)
        changed = from_rgb(changed, self.colour).round().clamp(0, 255)
        rounded = changed.to(torch.uint8, memory_format=torch.channels_last)
        return rounded.permute(0, 2, 3, 1).reshape(images.shape)

    def _corrected(self, change: Change, labels: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Return the labels of changed images, -1..1 [n, targets]."""
        if self.label.is_steering or change.rig is None:
            return np.clip(change.steer(labels, drawn), -1, 1)
        steering = change.rig.steering_of(self.label.curvature(labels, change.rig))
        return np.clip(self.label.of(change.steer(steering, drawn), change.rig), -1, 1)

    def _streams(self, seed: int) -> Iterator[np.random.Generator]:
        """Yield a random stream for each transform.

        With one stream for all, as in albumentations, every shifted image would also be blurred.
        """
        return map(np.random.default_rng, np.random.SeedSequence(seed).spawn(len(self.transforms)))


def _draw(
    change: Change, shape: tuple[int, ...], count: int, rng: np.random.Generator, place: Place
) -> tuple[np.ndarray, np.ndarray]:
    """Return the changed samples of a shard, int64 [n], and their values, float64 [n, K]."""
    first, whole = place
    chosen = np.flatnonzero(rng.random(whole) < change.p)
    drawn = change.draw((len(chosen), *shape), rng)
    ours = slice(*np.searchsorted(chosen, [first, first + count]))
    return chosen[ours] - first, drawn[ours]


def _composed(transform: "albumentations.BasicTransform") -> "albumentations.Compose":
    from albumentations import Compose

    return Compose([transform], seed=0)


def _convert(images: np.ndarray, code: int) -> None:
    """Convert the colours of images uint8 [..., H, W, 3] in place, all as one tall image."""
    tall = images.reshape(-1, *images.shape[-2:])
    cv2.cvtColor(tall, code, tall)
