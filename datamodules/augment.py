"""Augmentations, and the transforms of ours that albumentations lacks.

A transform works on a view's picture and may change the steering. One more is a class that
albumentations has, or one here, and a YAML in `conf/augment`.

Ours also take a whole batch, in place: `change_batch` draws what albumentations would draw picture
by picture, and calls the same OpenCV functions, without its checks and copies, which cost ten times
as much as the change itself: 50 us a picture of 66 x 200 for all three, against 600.
"""

import os

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # it asks the network for its own version

import albumentations
import cv2
import numpy as np


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
        lit = img.copy()
        _light(lit, factor)
        return lit

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """`apply`'s arguments for each of a batch of `shape`."""
        low, high = self.scale
        return [{"factor": factor} for factor in rng.uniform(low, high, shape[0])]

    def change_one(self, picture: np.ndarray, factor: float) -> None:
        """`apply`, in place."""
        _light(picture, factor)


class Shadow(albumentations.RandomShadow):
    """albumentations' shadow, known as a change of light: saturation does not see it."""

    lighting = True

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """`apply`'s arguments for each of a batch of `shape`."""
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
        self, picture: np.ndarray, vertices_list: np.ndarray, intensities: np.ndarray
    ) -> None:
        """`apply`, in place; it rounds half a grey level otherwise."""
        for vertices, intensity in zip(vertices_list, intensities, strict=True):
            mask = np.zeros(picture.shape[:2], np.uint8)
            cv2.fillPoly(mask, [vertices.astype(np.int32)], 255)
            dark = cv2.convertScaleAbs(picture, alpha=1 - intensity)
            cv2.copyTo(dark, mask, picture)


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
        # Outside stands what the edge has. Within a grey level of warpAffine, in half its time.
        center = (width - 1) / 2 - right * width / 320, (height - 1) / 2 - down
        return _shape_like(cv2.getRectSubPix(img, (width, height), center), img)

    def apply_to_steering(self, steering: float, right: float, **_: object) -> float:
        return float(np.clip(steering + right * self.steering_per_pixel, -1, 1))

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """`apply`'s arguments for each of a batch of `shape`."""
        right = rng.uniform(-self.pixels, self.pixels, shape[0])
        down = rng.uniform(-self.rows, self.rows, shape[0])
        return [{"right": x, "down": y} for x, y in zip(right, down, strict=True)]

    def change_one(self, picture: np.ndarray, right: float, down: float) -> None:
        """`apply`, in place."""
        picture[:] = self.apply(picture, right, down)


class Augment:
    """Transforms in a row, for pictures of one colour.

    A change of light happens to the colours of the scene, so a `yuv` picture is turned to RGB and
    back for it, and saturation (`hsv_s`), which light does not change, is left alone.
    """

    def __init__(self, transforms: list[albumentations.BasicTransform], colour: str) -> None:
        if colour == "hsv_s":
            transforms = [one for one in transforms if not getattr(one, "lighting", False)]
        self.transforms, self.colour = transforms, colour
        self.changes = [_change_of(one) for one in transforms]

    def __call__(
        self, pictures: np.ndarray, steering: np.ndarray, seed: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """uint8 [N, H, W, C] and float32 [N] -> the same, changed as `seed` decides."""
        if not self.changes:
            return pictures, steering
        changed, corrected = pictures.copy(), steering.copy()
        self.in_place(changed, corrected, seed)
        return changed, corrected

    def in_place(
        self,
        pictures: np.ndarray,
        steering: np.ndarray,
        seed: int,
        place: tuple[int, int] | None = None,
    ) -> None:
        """As a call, but into the arrays that are given.

        Args:
            place: of a share of a batch: where in it the share begins, and the batch's size. A
                share is changed as it would be within the whole.
        """
        if not self.changes or not len(pictures):
            return
        place = place or (0, len(pictures))
        if self.colour == "yuv":
            _convert(pictures, cv2.COLOR_YUV2RGB)
        # A stream of draws for each transform: albumentations gives all of them the same, so that
        # what is shifted would always be blurred too.
        streams = np.random.SeedSequence(seed).spawn(len(self.changes))
        for change, stream in zip(self.changes, streams, strict=True):
            change(pictures, steering, np.random.default_rng(stream), place)
        if self.colour == "yuv":
            _convert(pictures, cv2.COLOR_RGB2YUV)


class _OneByOne:
    """A transform of albumentations, on a batch in place."""

    def __init__(self, transform: albumentations.BasicTransform) -> None:
        self.transform = transform
        self.compose = albumentations.Compose([transform], seed=0)

    def __call__(
        self,
        pictures: np.ndarray,
        steering: np.ndarray,
        rng: np.random.Generator,
        place: tuple[int, int],
    ) -> None:
        first, whole = place
        seeds = rng.integers(2**31, size=whole)[first : first + len(pictures)]
        for index, (picture, seed) in enumerate(zip(pictures, seeds.tolist(), strict=True)):
            self.transform.set_random_seed(seed)
            result = self.compose(image=picture, steering=float(steering[index]))
            picture[:] = result["image"].reshape(picture.shape)
            steering[index] = result["steering"]


class _AllAtOnce:
    """One of our transforms, on a batch in place."""

    def __init__(self, transform: albumentations.BasicTransform) -> None:
        self.transform = transform
        self.steers = hasattr(transform, "apply_to_steering")

    def __call__(
        self,
        pictures: np.ndarray,
        steering: np.ndarray,
        rng: np.random.Generator,
        place: tuple[int, int],
    ) -> None:
        first, whole = place
        chosen = np.flatnonzero(rng.random(whole) < self.transform.p)
        draws = self.transform.draw_batch((len(chosen), *pictures.shape[1:]), rng)
        ours = slice(*np.searchsorted(chosen, [first, first + len(pictures)]))
        # One thread: several wait for each other, as Python has but one between OpenCV's calls.
        for index, drawn in zip((chosen[ours] - first).tolist(), draws[ours], strict=True):
            self.transform.change_one(pictures[index], **drawn)
            if self.steers:
                steering[index] = self.transform.apply_to_steering(steering[index], **drawn)


def _change_of(transform: albumentations.BasicTransform) -> "_OneByOne | _AllAtOnce":
    return (_AllAtOnce if hasattr(transform, "change_one") else _OneByOne)(transform)


def _light(picture: np.ndarray, factor: float) -> None:
    """Scale V of HSV in place."""
    if factor <= 1 or picture.shape[2] == 1:
        cv2.convertScaleAbs(picture, picture, alpha=factor)
        return
    hsv = cv2.cvtColor(picture, cv2.COLOR_RGB2HSV)
    hsv[:, :, 2] = cv2.convertScaleAbs(hsv[:, :, 2], alpha=factor)
    cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB, picture)


def _convert(pictures: np.ndarray, code: int) -> None:
    """Turn the colours of pictures uint8 [N, H, W, 3] in place, all as one tall picture."""
    tall = pictures.reshape(-1, *pictures.shape[2:])
    cv2.cvtColor(tall, code, tall)


def _shape_like(picture: np.ndarray, original: np.ndarray) -> np.ndarray:
    """OpenCV drops a last axis of one; put it back."""
    return picture.reshape(original.shape)
