"""Augmentations, and the transforms of ours that albumentations lacks.

A transform works on a view's picture and may change the steering. One more is a class that
albumentations has, or one here, and a YAML in `conf/augment`.
"""

import os

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # it asks the network for its own version

import albumentations
import cv2
import numpy as np

from datamodules.view import view_to_rgb


class Brightness(albumentations.ImageOnlyTransform):
    """Scale the V channel of HSV by a random factor, as the course's solutions do.

    That is to scale red, green and blue alike, but never beyond white, so that hue and saturation
    stay; a grey picture is scaled likewise.

    Args:
        scale: the range of the factor.
        p: the probability of a sample to be changed.
    """

    lighting = True

    def __init__(self, scale: tuple[float, float] = (0.25, 1.25), p: float = 1.0) -> None:
        super().__init__(p=p)
        self.scale = tuple(scale)

    def get_params(self) -> dict:
        return {"factor": self.py_random.uniform(*self.scale)}

    def apply(self, img: np.ndarray, factor: float, **_: object) -> np.ndarray:
        if factor <= 1 or img.shape[2] == 1:
            return _shape_like(cv2.convertScaleAbs(img, alpha=factor), img)
        hsv = cv2.cvtColor(img, cv2.COLOR_RGB2HSV)
        hsv[:, :, 2] = cv2.convertScaleAbs(hsv[:, :, 2], alpha=factor)
        return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)


class Shadow(albumentations.RandomShadow):
    """albumentations' shadow, known as a change of light: saturation does not see it."""

    lighting = True


class Shift(albumentations.ImageOnlyTransform):
    """Shift sideways, with the steering corrected per pixel, and up or down, as slopes do.

    Scenery that moved to the right is what a car too far to the left sees: it must steer right.
    From V. Yadav, "An augmentation based deep neural network approach to learn human driving
    behavior", 2016.

    Args:
        pixels: the largest shift to either side, in pixels of the 320 wide recording.
        rows: the largest shift up or down, in rows of the view.
        steering_per_pixel: what a pixel of the recording adds to the steering.
        p: the probability of a sample to be changed.
    """

    def __init__(
        self,
        pixels: float = 40.0,
        rows: float = 0.0,
        steering_per_pixel: float = 0.004,
        p: float = 0.5,
    ) -> None:
        super().__init__(p=p)
        self.pixels, self.rows, self.steering_per_pixel = pixels, rows, steering_per_pixel

    @property
    def targets(self) -> dict:
        return {**super().targets, "steering": self.apply_to_steering}

    def get_params(self) -> dict:
        return {
            "right": self.py_random.uniform(-self.pixels, self.pixels),
            "down": self.py_random.uniform(-self.rows, self.rows),
        }

    def apply(self, img: np.ndarray, right: float, down: float, **_: object) -> np.ndarray:
        height, width = img.shape[:2]
        matrix = np.float32([[1, 0, right * width / 320], [0, 1, down]])
        moved = cv2.warpAffine(img, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
        return _shape_like(moved, img)

    def apply_to_steering(self, steering: float, right: float, **_: object) -> float:
        return float(np.clip(steering + right * self.steering_per_pixel, -1, 1))


class Augment:
    """Transforms in a row, for pictures of one colour.

    A change of light happens to the colours of the scene, so a `yuv` picture is turned to RGB and
    back for it, and saturation (`hsv_s`), which light does not change, is left alone.
    """

    def __init__(self, transforms: list[albumentations.BasicTransform], colour: str) -> None:
        if colour == "hsv_s":
            transforms = [one for one in transforms if not getattr(one, "lighting", False)]
        self.colour = colour
        self.compose = albumentations.Compose(transforms, seed=0) if transforms else None

    def __call__(
        self, pictures: np.ndarray, steering: np.ndarray, seed: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """uint8 [N, H, W, C] and float32 [N] -> the same, changed as `seed` decides."""
        if self.compose is None:
            return pictures, steering
        # Not by the compose's own seed, which gives all of them the same draws: what is shifted
        # would always be blurred too.
        own_seeds = np.random.SeedSequence(seed).generate_state(len(self.compose.transforms))
        for transform, own_seed in zip(self.compose.transforms, own_seeds, strict=True):
            transform.set_random_seed(int(own_seed))
        out, corrected = np.empty_like(pictures), steering.copy()
        for index, picture in enumerate(pictures):
            if self.colour == "yuv":
                picture = view_to_rgb(picture, "yuv")
            result = self.compose(image=picture, steering=float(steering[index]))
            picture = result["image"]
            if self.colour == "yuv":
                picture = cv2.cvtColor(picture, cv2.COLOR_RGB2YUV)
            out[index] = picture.reshape(out.shape[1:])
            corrected[index] = result["steering"]
        return out, corrected


def _shape_like(picture: np.ndarray, original: np.ndarray) -> np.ndarray:
    """OpenCV drops a last axis of one; put it back."""
    return picture.reshape(original.shape)
