"""Augmentations: changes that albumentations lacks, and their use on a batch.

An augmentation is a class of albumentations, or a `Change`, and a YAML file in `conf/augment`.

A `Change` draws for a whole batch. On the CPU it changes each image in place with OpenCV, without
the checks and copies of albumentations, which cost ten times as much as the change: 50 us per image
of 66 x 200 for all three, against 600. On the device that trains it changes the batch at once.
"""

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch
from torch import Tensor

from datamodules.device_augment import darkened, from_rgb, lit, moved, to_rgb
from datamodules.view import CODES, FRAME
from zoo.base.rig import STEERING, UDACITY, Rig, SteeringLabel

if TYPE_CHECKING:
    import albumentations  # slow import, which most trainings do without

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # disables its version check online

Place = tuple[int, int]  # first index of a shard in its batch, and the batch's size


class Change:
    """Base of augmentations that change a batch by the same draws on the CPU and on a device.

    Attributes:
        p: probability that a sample is changed, 0..1.
        lighting: whether it changes the light alone, which saturation does not show.
        zeros_change_nothing: whether `change_all` leaves an image whose values are 0 as it is.
        rig: car as whose steering it changes other labels; None if it changes the label itself.
    """

    p: float
    lighting = False
    zeros_change_nothing = False
    rig: Rig | None = None

    def fit(self, crop: tuple[int, int], rig: Rig | None) -> None:
        """Take a view's crop and a recording's rig; most changes depend on neither."""

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Return random values, float64 [n, K], of the images of a batch of `shape`."""
        raise NotImplementedError

    def change_one(self, image: np.ndarray, drawn: np.ndarray) -> None:
        """Change an image, uint8 [H, W, C], in place by its values, float64 [K]."""
        raise NotImplementedError

    def change_all(self, images: Tensor, drawn: Tensor) -> Tensor:
        """Return images, float32 [n, C, H, W], 0..255, changed by values, float32 [n, K]."""
        raise NotImplementedError

    def steer(self, steering: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Return the corrected steering, not yet clipped, float [n, targets], by values [n, K]."""
        return steering


class Brightness(Change):
    """Scale the V channel of HSV by a random factor, as the course's solutions do.

    Red, green and blue are scaled equally, but never beyond white: hue and saturation do not
    change. A grey image is scaled in the same way.

    Args:
        scale: range of the factor.
        p: probability that a sample is changed, 0..1.
    """

    lighting = True

    def __init__(self, scale: tuple[float, float] = (0.25, 1.25), p: float = 1.0) -> None:
        self.scale, self.p = tuple(scale), p

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Return factors."""
        low, high = self.scale
        return rng.uniform(low, high, (shape[0], 1))

    def change_one(self, image: np.ndarray, drawn: np.ndarray) -> None:
        """Scale an image in place."""
        factor = float(drawn[0])
        if factor <= 1 or image.shape[2] == 1:
            cv2.convertScaleAbs(image, image, alpha=factor)
            return
        hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
        hsv[:, :, 2] = cv2.convertScaleAbs(hsv[:, :, 2], alpha=factor)
        cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB, image)

    def change_all(self, images: Tensor, drawn: Tensor) -> Tensor:
        """Return scaled images."""
        return lit(images, drawn[:, 0])


class Shadow(Change):
    """The shadow of albumentations, within half a grey level.

    Args:
        shadow_roi: part of the frame with shadows: left, top, right, bottom, 0..1.
        num_shadows_limit: range of the number of shadows.
        shadow_dimension: corners of a shadow.
        shadow_intensity_range: range of the share of the brightness that a shadow takes, 0..1.
        p: probability that a sample is changed, 0..1.

    Raises:
        ValueError: albumentations refuses a value.
    """

    lighting = zeros_change_nothing = True

    def __init__(
        self,
        shadow_roi: tuple[float, float, float, float] = (0, 0.5, 1, 1),
        num_shadows_limit: tuple[int, int] = (1, 2),
        shadow_dimension: int = 5,
        shadow_intensity_range: tuple[float, float] = (0.5, 0.5),
        p: float = 0.5,
    ) -> None:
        from albumentations import RandomShadow

        settings = (shadow_roi, num_shadows_limit, shadow_dimension, shadow_intensity_range, p)
        checked = RandomShadow(*settings)
        self.shadow_roi, self.num_shadows_limit = checked.shadow_roi, checked.num_shadows_limit
        self.shadow_dimension, self.p = checked.shadow_dimension, checked.p
        self.shadow_intensity_range = checked.shadow_intensity_range

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Return each shadow's corners (column, row) and intensity, which is 0 without a shadow."""
        left, top, right, bottom = self.shadow_roi
        low = np.array([left * shape[2], top * shape[1]], int)
        high = np.array([right * shape[2], bottom * shape[1]], int)
        fewest, most = self.num_shadows_limit
        corners = rng.integers(low, high, (shape[0], most, self.shadow_dimension, 2))
        faintest, darkest = self.shadow_intensity_range
        intensities = rng.uniform(faintest, darkest, (shape[0], most))
        counts = rng.integers(fewest, most + 1, shape[0])
        intensities[np.arange(most) >= counts[:, None]] = 0
        size = 2 * self.shadow_dimension  # not -1, because a batch may have no shadow
        values = [corners.reshape(shape[0], most, size), intensities[:, :, None]]
        return np.concatenate(values, 2).reshape(shape[0], most * (size + 1))

    def change_one(self, image: np.ndarray, drawn: np.ndarray) -> None:
        """Darken an image in place."""
        for *corners, intensity in drawn.reshape(-1, 2 * self.shadow_dimension + 1):
            mask = np.zeros(image.shape[:2], np.uint8)
            cv2.fillPoly(mask, [np.array(corners, np.int32).reshape(-1, 2)], 255)
            cv2.copyTo(cv2.convertScaleAbs(image, alpha=1 - intensity), mask, image)

    def change_all(self, images: Tensor, drawn: Tensor) -> Tensor:
        """Return darkened images."""
        for shadow in drawn.unflatten(1, (-1, 2 * self.shadow_dimension + 1)).unbind(1):
            images = darkened(images, shadow[:, :-1].unflatten(1, (-1, 2)), shadow[:, -1])
        return images


class Shift(Change):
    """Shift sideways, with the steering corrected per pixel, and up or down, as on slopes.

    A car that is too far left sees the scenery moved to the right, and must steer right.
    From V. Yadav, "An augmentation based deep neural network approach to learn human driving
    behavior", 2016.

    Args:
        pixels: largest shift to either side, in 320ths of a frame's width.
        rows: largest shift up or down, in rows of the view.
        steering_per_pixel: steering of Udacity's car added for each 320th of a shift.
        p: probability that a sample is changed, 0..1.
    """

    rig = UDACITY
    zeros_change_nothing = True

    def __init__(
        self,
        pixels: float = 40.0,
        rows: float = 0.0,
        steering_per_pixel: float = 0.004,
        p: float = 0.5,
    ) -> None:
        self.pixels, self.rows, self.p = pixels, rows, p
        self.steering_per_pixel = steering_per_pixel

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Return shifts to the right and down."""
        right = rng.uniform(-self.pixels, self.pixels, shape[0])
        return np.stack([right, rng.uniform(-self.rows, self.rows, shape[0])], 1)

    def change_one(self, image: np.ndarray, drawn: np.ndarray) -> None:
        """Shift an image in place; its edges are repeated."""
        height, width = image.shape[:2]
        # The result is within a grey level of warpAffine's, in half the time.
        center = (width - 1) / 2 - drawn[0] * width / FRAME[1], (height - 1) / 2 - drawn[1]
        image[:] = cv2.getRectSubPix(image, (width, height), center).reshape(image.shape)

    def change_all(self, images: Tensor, drawn: Tensor) -> Tensor:
        """Return shifted images."""
        return moved(images, drawn[:, :1] * (images.shape[3] / FRAME[1]), drawn[:, 1])

    def steer(self, steering: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Return the steering corrected by the columns of the shift."""
        return steering + drawn[:, :1] * self.steering_per_pixel


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
                    image[:] = compose(image=image)["image"].reshape(image.shape)
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
