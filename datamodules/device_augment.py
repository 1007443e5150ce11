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
import torch.nn.functional as F
from torch import Tensor

from datamodules.augment import Brightness, Shadow, Shift
from datamodules.bend import Bend, added_steering
from datamodules.image import FRAME_WIDTH
from zoo.base.errors import InputError

# OpenCV's matrices for 8-bit images; a row each for Y, U and V. For grey, U and V are 128.
_YUV = ((0.299, 0.587, 0.114), (-0.147108, -0.288804, 0.435912), (0.614777, -0.514799, -0.099978))
_RGB = ((1.0, 0.0, 1.140), (1.0, -0.395, -0.581), (1.0, 2.032, 0.0))
Draw = Callable[[tuple[int, int, int, int], np.random.Generator], np.ndarray]


def lit(images: Tensor, factor: Tensor) -> Tensor:
    """Scale each image by its factor, float32 [n].

    No channel exceeds white, so that hue and saturation do not change.
    """
    brightest = images.amax(1, keepdim=True).clamp(min=1.0)
    return images * torch.minimum(factor[:, None, None, None], 255.0 / brightest)


def darkened(images: Tensor, corners: Tensor, intensity: Tensor) -> Tensor:
    """Darken each image within its polygon, float32 [n, K, 2], by a share 0..1, float32 [n]."""
    mask = polygons(corners, *images.shape[2:])[:, None]
    return torch.where(mask, images * (1 - intensity)[:, None, None, None], images)


def polygons(corners: Tensor, height: int, width: int) -> Tensor:
    """Return the mask of polygons, bool [n, H, W].

    Corners are float32 [n, K, 2], whole columns and rows. As in OpenCV, a pixel is inside if an odd
    number of edges lies to its right, or if it is on the outline.
    """
    rows = torch.arange(height, device=corners.device)[None, :, None]
    columns = torch.arange(width, device=corners.device)[None, None, :]
    inside = torch.zeros(len(corners), height, width, dtype=torch.bool, device=corners.device)
    outline = inside.clone()
    count = corners.shape[1]
    for number in range(count):
        x1, y1 = corners[:, number, :, None, None].unbind(1)
        x2, y2 = corners[:, (number + 1) % count, :, None, None].unbind(1)
        across, down = x2 - x1, y2 - y1
        column = x1 + (rows - y1) * across / torch.where(down == 0, 1.0, down)
        row = y1 + (columns - x1) * down / torch.where(across == 0, 1.0, across)
        inside ^= ((y1 > rows) != (y2 > rows)) & (columns < column)
        within = (rows - y1) * (rows - y2) <= 0
        between = (columns - x1) * (columns - x2) <= 0
        steep = down.abs() > across.abs()
        outline |= steep & within & ((columns - column).abs() <= 0.5)
        outline |= ~steep & between & ((rows - row).abs() <= 0.5)
    return inside | outline


def moved(images: Tensor, right: Tensor, down: Tensor, beyond: str = "border") -> Tensor:
    """Move each row to the right, and each image down.

    Args:
        images: images.
        right: columns to move each row, float32 [n, H] or [n, 1].
        down: rows to move each image, float32 [n].
        beyond: source of pixels outside the image: its `border`, as OpenCV's BORDER_REPLICATE, or
            its `reflection`, as BORDER_REFLECT_101.
    """
    count, _, height, width = images.shape
    columns = torch.arange(width, device=images.device, dtype=torch.float32)
    rows = torch.arange(height, device=images.device, dtype=torch.float32)
    x = columns[None, None, :] - right[:, :, None]
    y = rows[None, :, None] - down[:, None, None]
    grid = torch.stack(
        [
            (2 * x / max(width - 1, 1) - 1).expand(count, height, width),
            (2 * y / max(height - 1, 1) - 1).expand(count, height, width),
        ],
        -1,
    )
    return F.grid_sample(images, grid, "bilinear", padding_mode=beyond, align_corners=True)


def to_rgb(images: Tensor, colour: str) -> Tensor:
    """Convert a view's images to RGB as OpenCV does for 8 bits, but without rounding."""
    match colour:
        case "bgr":
            return images.flip(1)
        case "yuv":
            return _rgb_of_yuv(images)
        case "yuv_old":
            return _rgb_of_yuv(images).flip(1)
        case "hsv":
            return _rgb_of_hsv(images)
    return images


def from_rgb(images: Tensor, colour: str) -> Tensor:
    """Convert RGB to a view's colour as OpenCV does for 8 bits, but without rounding."""
    match colour:
        case "bgr":
            return images.flip(1)
        case "yuv":
            return _yuv_of_rgb(images)
        case "yuv_old":
            return _yuv_of_rgb(images.flip(1))
        case "hsv":
            return _hsv_of_rgb(images)
    return images


def _rgb_of_hsv(images: Tensor) -> Tensor:
    hue, saturation, value = images.unbind(1)
    # Each channel is V within 30 of its own hue, and V less S beyond 60; hues repeat after 180.
    own = hue.new_tensor([0.0, 60.0, 120.0])[:, None, None]
    away = ((hue[:, None] - own + 90) % 180 - 90).abs()
    share = (away / 30 - 1).clamp(0, 1)
    return value[:, None] * (1 - share * saturation[:, None] / 255)


def _hsv_of_rgb(images: Tensor) -> Tensor:
    images = images.clamp(0, 255)
    red, green, blue = images.unbind(1)
    value, spread = images.amax(1), images.amax(1) - images.amin(1)
    by = spread.clamp(min=1e-6) / 30
    hue = torch.where(value == green, 60 + (blue - red) / by, 120 + (red - green) / by)
    hue = torch.where(value == red, (green - blue) / by, hue)
    hue = hue.round() % 180  # 179.6 is a hue of 0
    return torch.stack([hue, 255 * spread / value.clamp(min=1e-6), value], 1)


def _rgb_of_yuv(images: Tensor) -> Tensor:
    grey = images.new_tensor([0.0, 128.0, 128.0])[:, None, None]
    return _mixed(images - grey, _RGB).clamp(0, 255)


def _yuv_of_rgb(images: Tensor) -> Tensor:
    grey = images.new_tensor([0.0, 128.0, 128.0])[:, None, None]
    return _mixed(images.clamp(0, 255), _YUV) + grey


def _mixed(images: Tensor, matrix: tuple[tuple[float, ...], ...]) -> Tensor:
    # Sums of products: a GPU would compute a product of matrices in TF32.
    channels = images.unbind(1)
    rows = [sum(w * one for w, one in zip(row, channels, strict=True)) for row in matrix]
    return torch.stack(rows, 1)  # type: ignore[arg-type]  # mypy: an empty sum would be 0


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
