"""Augmentations that albumentations lacks.

An augmentation is a class of albumentations, or a `Change`, and a YAML file in `conf/augment`.

A `Change` draws for a whole batch. On the CPU it changes each image in place with OpenCV, without
the checks and copies of albumentations, which cost ten times as much as the change: 50 us per image
of 66 x 200 for all three, against 600. On the device that trains it changes the batch at once.
"""

import os

import cv2
import numpy as np
from torch import Tensor

from datamodules.balance import Least0, Share
from datamodules.device_augment import darkened, lit, moved
from datamodules.view import FRAME
from zoo.base.rig import UDACITY, Rig

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # disables its version check online


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

    def __init__(self, scale: tuple[Least0, Least0] = (0.25, 1.25), p: Share = 1.0) -> None:
        self.scale, self.p = sorted(scale), p

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Return factors."""
        return rng.uniform(self.scale[0], self.scale[1], (shape[0], 1))

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
        p: Share = 0.5,
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
        intensities[np.arange(most) >= rng.integers(fewest, most + 1, shape[0])[:, None]] = 0
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
        pixels: Least0 = 40.0,
        rows: Least0 = 0.0,
        steering_per_pixel: float = 0.004,
        p: Share = 0.5,
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
