"""Augmentations as torch operations on a whole batch, on the device that trains.

Each uses the random draws of its counterpart in `augment.py` or `bend.py`, and changes images as
OpenCV does, except that an image is rounded once, after all changes. numpy draws and corrects the
steering, so that both are the same on every device.
"""

from collections.abc import Callable
from dataclasses import dataclass

import albumentations
import numpy as np
import torch
from torch import Tensor

from datamodules.augment import Brightness, Shadow, Shift
from datamodules.bend import Bend, added_steering
from datamodules.device_pictures import darkened, from_rgb, lit, moved, to_rgb
from datamodules.image import FRAME_WIDTH
from zoo.base.errors import InputError

Draw = Callable[[tuple[int, int, int, int], np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class DeviceChange:
    """An augmentation of a batch.

    Attributes:
        p: probability that an image is changed, 0..1.
        draw: function from a shape (n, height, width, channels) and a generator to float [n, K].
        change: function from images float32 [n, C, H, W], 0..255, and draws to changed images.
        steer: function from steering float32 [n] or [K, n] and draws to steering; None if
            unchanged.
    """

    p: float
    draw: Draw
    change: Callable[[Tensor, Tensor], Tensor]
    steer: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None


class DeviceAugment:
    """The transforms of `Augment`, on a device.

    Raises:
        InputError: a transform has no equivalent here.
    """

    def __init__(self, transforms: list[albumentations.BasicTransform], colour: str) -> None:
        missing = without_equivalent(transforms)
        if missing:
            raise InputError(
                f"data.augment_on=device: {', '.join(missing)} has no equivalent on the device; "
                "leave it out of augment=[...], or set data.augment_on=cpu"
            )
        self.colour = colour
        self.changes = [EQUIVALENTS[type(one)](one) for one in transforms]

    def __call__(
        self,
        images: Tensor,
        steering: np.ndarray,
        seed: int,
        place: tuple[int, int] | None = None,
    ) -> tuple[Tensor, np.ndarray]:
        """Return uint8 [n, H, W, C] images and float32 [n] steering, changed by `seed`.

        `place`, and windows of images, are as in `Augment.in_place`.
        """
        if not self.changes or not len(images):
            return images, steering
        frames = images.reshape(-1, *images.shape[-3:])
        changed = to_rgb(frames.permute(0, 3, 1, 2).float(), self.colour)
        place = place or (0, len(images))
        streams = np.random.SeedSequence(seed).spawn(len(self.changes))
        for one, stream in zip(self.changes, streams, strict=True):
            rng = np.random.default_rng(stream)
            changed, steering = _apply(one, changed, steering, rng, place)
        changed = from_rgb(changed, self.colour)
        rounded = changed.round().clamp(0, 255).to(torch.uint8, memory_format=torch.channels_last)
        return rounded.permute(0, 2, 3, 1).reshape(images.shape), steering


def without_equivalent(transforms: list[albumentations.BasicTransform]) -> list[str]:
    """Return the names of transforms that only the CPU has."""
    return [type(one).__name__ for one in transforms if type(one) not in EQUIVALENTS]


def _apply(
    one: DeviceChange,
    images: Tensor,
    steering: np.ndarray,
    rng: np.random.Generator,
    place: tuple[int, int],
) -> tuple[Tensor, np.ndarray]:
    first, whole = place
    chosen = np.flatnonzero(rng.random(whole) < one.p)
    count, (channels, height, width) = len(steering), images.shape[1:]
    sequence = len(images) // count
    drawn = one.draw((len(chosen), height, width, channels), rng)
    ours = slice(*np.searchsorted(chosen, [first, first + count]))
    chosen, drawn = chosen[ours] - first, drawn[ours]
    if not len(chosen):
        return images, steering
    each = np.repeat(drawn.astype(np.float32), sequence, axis=0)  # a window's frames change alike
    values = torch.from_numpy(each).to(images.device, non_blocking=True)
    if len(chosen) == count:
        images = one.change(images, values)
    else:
        frames = (chosen[:, None] * sequence + np.arange(sequence)).ravel()
        at = torch.from_numpy(frames).to(images.device, non_blocking=True)
        images = images.index_copy(0, at, one.change(images[at], values))
    if one.steer is not None:
        steering = steering.copy()
        steering[chosen] = one.steer(steering[chosen].T, drawn).T
    return images, steering


def _brightness(transform: Brightness) -> DeviceChange:
    def draw(shape: tuple, rng: np.random.Generator) -> np.ndarray:
        low, high = transform.scale
        return rng.uniform(low, high, shape[0])[:, None]

    return DeviceChange(transform.p, draw, lambda images, drawn: lit(images, drawn[:, 0]))


def _shadow(transform: Shadow) -> DeviceChange:
    corners = transform.shadow_dimension

    def draw(shape: tuple, rng: np.random.Generator) -> np.ndarray:
        """Return each shadow's corners (column, row) and intensity; 0 without a shadow."""
        drawn = transform.draw_batch(shape, rng)
        most = transform.num_shadows_limit[1]
        values = np.zeros((shape[0], most, 2 * corners + 1))
        for at, one in enumerate(drawn):
            count = len(one["intensities"])
            values[at, :count, :-1] = one["vertices_list"].reshape(count, -1)
            values[at, :count, -1] = one["intensities"]
        return values.reshape(shape[0], -1)

    def change(images: Tensor, drawn: Tensor) -> Tensor:
        for shadow in drawn.unflatten(1, (-1, 2 * corners + 1)).unbind(1):
            outline = shadow[:, :-1].unflatten(1, (corners, 2))
            images = darkened(images, outline, shadow[:, -1])
        return images

    return DeviceChange(transform.p, draw, change)


def _shift(transform: Shift) -> DeviceChange:
    def draw(shape: tuple, rng: np.random.Generator) -> np.ndarray:
        right = rng.uniform(-transform.pixels, transform.pixels, shape[0])
        return np.stack([right, rng.uniform(-transform.rows, transform.rows, shape[0])], 1)

    def change(images: Tensor, drawn: Tensor) -> Tensor:
        return moved(images, drawn[:, :1] * (images.shape[3] / FRAME_WIDTH), drawn[:, 1])

    def steer(steering: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        return np.clip(steering + drawn[:, 0] * transform.steering_per_pixel, -1, 1)

    return DeviceChange(transform.p, draw, change, steer)


def _bend(transform: Bend) -> DeviceChange:
    def draw(shape: tuple, rng: np.random.Generator) -> np.ndarray:
        """Return the added steering, and each row's move in columns of the view."""
        drawn = transform.draw_batch(shape, rng)
        names = ("curvature", "begin", "length")
        values = np.array([[one[name] for name in names] for one in drawn]).reshape(-1, 3)
        curvature, begin, length = values.T[:, :, None]
        aside = transform.columns_aside(shape[1], curvature, begin, length)
        added = added_steering(curvature, begin)
        return np.concatenate([added, aside * shape[2] / FRAME_WIDTH], 1)

    def change(images: Tensor, drawn: Tensor) -> Tensor:
        return moved(images, drawn[:, 1:], torch.zeros_like(drawn[:, 0]), beyond="reflection")

    def steer(steering: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        return np.clip(steering + drawn[:, 0], -1, 1)

    return DeviceChange(transform.p, draw, change, steer)


EQUIVALENTS: dict[type, Callable[[albumentations.BasicTransform], DeviceChange]] = {
    Brightness: _brightness,
    Shadow: _shadow,
    Shift: _shift,
    Bend: _bend,
}
