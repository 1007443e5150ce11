"""Augmentations: transforms that albumentations lacks, and their use on a batch.

A transform changes a view's image and may change the steering. A new one is a class of
albumentations, or a class here, and a YAML in `conf/augment`.

Our transforms also change a whole batch in place: `draw_batch` draws for all images, and
`change_one` calls the same OpenCV functions as albumentations, without its checks and copies, which
cost ten times as much as the change: 50 us per image of 66 x 200 for all three, against 600.
"""

import os

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # disables its version check online

import albumentations
import cv2
import numpy as np

from datamodules.view import CODES


class Brightness(albumentations.ImageOnlyTransform):
    """Scale the V channel of HSV by a random factor, as the course's solutions do.

    Red, green and blue are scaled equally, but never beyond white: hue and saturation do not
    change. A grey image is scaled in the same way.

    Args:
        scale: range of the factor.
        p: probability that a sample is changed, 0..1.
    """

    lighting = True

    def __init__(self, scale: tuple[float, float] = (0.25, 1.25), p: float = 1.0) -> None:
        super().__init__(p=p)
        self.scale = tuple(scale)

    def get_params(self) -> dict:
        """Draw the factor."""
        return {"factor": self.py_random.uniform(*self.scale)}

    def apply(self, img: np.ndarray, factor: float, **_: object) -> np.ndarray:
        """Return the image with another brightness."""
        lit = img.copy()
        _light(lit, factor)
        return lit

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """Return `apply`'s arguments for each image of a batch of `shape`."""
        low, high = self.scale
        return [{"factor": factor} for factor in rng.uniform(low, high, shape[0])]

    def change_one(self, image: np.ndarray, factor: float) -> None:
        """Change one image in place, as `apply`."""
        _light(image, factor)


class Shadow(albumentations.RandomShadow):
    """The shadow of albumentations, marked as a change of light."""

    lighting = True

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """Return `apply`'s arguments for each image of a batch of `shape`."""
        left, top, right, bottom = self.shadow_roi
        low = np.array([left * shape[2], top * shape[1]], int)
        high = np.array([right * shape[2], bottom * shape[1]], int)
        fewest, most = self.num_shadows_limit
        faintest, darkest = self.shadow_intensity_range
        corners = rng.integers(low, high, (shape[0], most, self.shadow_dimension, 2))
        intensities = rng.uniform(faintest, darkest, (shape[0], most))
        counts = rng.integers(fewest, most + 1, shape[0])
        return [
            {"vertices_list": corners[at, :count], "intensities": intensities[at, :count]}
            for at, count in enumerate(counts)
        ]

    def change_one(
        self, image: np.ndarray, vertices_list: np.ndarray, intensities: np.ndarray
    ) -> None:
        """Change one image in place, as `apply` within half a grey level."""
        for vertices, intensity in zip(vertices_list, intensities, strict=True):
            mask = np.zeros(image.shape[:2], np.uint8)
            cv2.fillPoly(mask, [vertices.astype(np.int32)], 255)
            dark = cv2.convertScaleAbs(image, alpha=1 - intensity)
            cv2.copyTo(dark, mask, image)


class Shift(albumentations.ImageOnlyTransform):
    """Shift sideways, with the steering corrected per pixel, and up or down, as on slopes.

    A car that is too far left sees the scenery moved to the right, and must steer right.
    From V. Yadav, "An augmentation based deep neural network approach to learn human driving
    behavior", 2016.

    Args:
        pixels: largest shift to either side, in columns of the recording's 320.
        rows: largest shift up or down, in rows of the view.
        steering_per_pixel: steering added per column of shift.
        p: probability that a sample is changed, 0..1.
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
        """Return functions by target: images as usual, and `steering`."""
        return {**super().targets, "steering": self.apply_to_steering}

    def get_params(self) -> dict:
        """Draw the shift."""
        return {
            "right": self.py_random.uniform(-self.pixels, self.pixels),
            "down": self.py_random.uniform(-self.rows, self.rows),
        }

    def apply(self, img: np.ndarray, right: float, down: float, **_: object) -> np.ndarray:
        """Return the shifted image."""
        height, width = img.shape[:2]
        # It repeats the edge. The result is within a grey level of warpAffine's, in half the time.
        center = (width - 1) / 2 - right * width / 320, (height - 1) / 2 - down
        return _shape_like(cv2.getRectSubPix(img, (width, height), center), img)

    def apply_to_steering(self, steering: float, right: float, **_: object) -> float:
        """Return the corrected steering, -1..1."""
        return float(np.clip(steering + right * self.steering_per_pixel, -1, 1))

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """Return `apply`'s arguments for each image of a batch of `shape`."""
        right = rng.uniform(-self.pixels, self.pixels, shape[0])
        down = rng.uniform(-self.rows, self.rows, shape[0])
        return [{"right": x, "down": y} for x, y in zip(right, down, strict=True)]

    def change_one(self, image: np.ndarray, right: float, down: float) -> None:
        """Change one image in place, as `apply`."""
        image[:] = self.apply(image, right, down)


class Augment:
    """A sequence of transforms for images of one colour.

    They apply to RGB: a `bgr`, `yuv`, `yuv_old` or `hsv` image is converted to RGB and back.
    Changes of light are left out for saturation (`hsv_s`).
    """

    def __init__(self, transforms: list[albumentations.BasicTransform], colour: str) -> None:
        if colour == "hsv_s":
            transforms = [one for one in transforms if not getattr(one, "lighting", False)]
        self.transforms, self.colour = transforms, colour
        self.changes = [_change_of(one) for one in transforms]

    def __call__(
        self, images: np.ndarray, steering: np.ndarray, seed: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return uint8 [N, H, W, C] images and float32 [N] steering, changed by `seed`."""
        if not self.changes:
            return images, steering
        changed, corrected = images.copy(), steering.copy()
        self.in_place(changed, corrected, seed)
        return changed, corrected

    def in_place(
        self,
        images: np.ndarray,
        steering: np.ndarray,
        seed: int,
        place: tuple[int, int] | None = None,
    ) -> None:
        """Change images and steering in place; all of a window's images and steering alike.

        Args:
            images: images, uint8 [n, H, W, C]; of windows, [n, sequence, H, W, C].
            steering: steering, float32 [n]; of windows, [n, sequence + ahead].
            seed: random seed of the batch.
            place: first index of a shard in its batch, and the batch's size; a shard is changed
                exactly as within the whole batch. None for a whole batch.
        """
        if not self.changes or not len(images):
            return
        place = place or (0, len(images))
        from_rgb, to_rgb = CODES.get(self.colour, (None, None))
        if images.ndim == 4:
            images, steering = images[:, None], steering[:, None]
        if to_rgb is not None:
            _convert(images, to_rgb)
        # Each transform has its own random stream. With one stream for all, as in albumentations,
        # every shifted image would also be blurred.
        streams = np.random.SeedSequence(seed).spawn(len(self.changes))
        for change, stream in zip(self.changes, streams, strict=True):
            change(images, steering, np.random.default_rng(stream), place)
        if from_rgb is not None:
            _convert(images, from_rgb)


class _OneByOne:
    """A transform of albumentations, applied to a batch of windows in place."""

    def __init__(self, transform: albumentations.BasicTransform) -> None:
        self.transform = transform
        self.compose = albumentations.Compose([transform], seed=0)

    def __call__(
        self,
        images: np.ndarray,
        steering: np.ndarray,
        rng: np.random.Generator,
        place: tuple[int, int],
    ) -> None:
        first, whole = place
        seeds = rng.integers(2**31, size=whole)[first : first + len(images)]
        steers = "steering" in self.transform.targets
        for frames, angles, seed in zip(images, steering, seeds.tolist(), strict=True):
            # Angles without a frame first, with the last frame before it changes.
            for at in reversed(range(len(angles) if steers else len(frames))):
                self.transform.set_random_seed(seed)  # the same draws for the whole window
                image = frames[min(at, len(frames) - 1)]
                result = self.compose(image=image, steering=float(angles[at]))
                if at < len(frames):
                    image[:] = result["image"].reshape(image.shape)
                angles[at] = result["steering"]


class _AllAtOnce:
    """One of our transforms, applied to a batch of windows in place."""

    def __init__(self, transform: albumentations.BasicTransform) -> None:
        self.transform = transform
        self.steers = hasattr(transform, "apply_to_steering")

    def __call__(
        self,
        images: np.ndarray,
        steering: np.ndarray,
        rng: np.random.Generator,
        place: tuple[int, int],
    ) -> None:
        first, whole = place
        chosen = np.flatnonzero(rng.random(whole) < self.transform.p)
        draws = self.transform.draw_batch((len(chosen), *images.shape[2:]), rng)
        ours = slice(*np.searchsorted(chosen, [first, first + len(images)]))
        # One thread: with several, Python's lock lets only one run between OpenCV's calls.
        for index, drawn in zip((chosen[ours] - first).tolist(), draws[ours], strict=True):
            for image in images[index]:
                self.transform.change_one(image, **drawn)
            if self.steers:
                for at, angle in enumerate(steering[index]):
                    steering[index, at] = self.transform.apply_to_steering(angle, **drawn)


def _change_of(transform: albumentations.BasicTransform) -> "_OneByOne | _AllAtOnce":
    return (_AllAtOnce if hasattr(transform, "change_one") else _OneByOne)(transform)


def _light(image: np.ndarray, factor: float) -> None:
    """Scale V of HSV in place."""
    if factor <= 1 or image.shape[2] == 1:
        cv2.convertScaleAbs(image, image, alpha=factor)
        return
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    hsv[:, :, 2] = cv2.convertScaleAbs(hsv[:, :, 2], alpha=factor)
    cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB, image)


def _convert(images: np.ndarray, code: int) -> None:
    """Convert the colours of images uint8 [..., H, W, 3] in place, all as one tall image."""
    tall = images.reshape(-1, *images.shape[-2:])
    cv2.cvtColor(tall, code, tall)


def _shape_like(image: np.ndarray, original: np.ndarray) -> np.ndarray:
    """Restore a last axis of one, which OpenCV drops."""
    return image.reshape(original.shape)
