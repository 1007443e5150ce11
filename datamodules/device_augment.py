"""The image operations of augmentations in torch, for a whole batch on the device that trains.

They change images as OpenCV does, but without rounding. Images are float32 [n, C, H, W], 0..255.
"""

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

# OpenCV's matrices for 8-bit images; a row each for Y, U and V. For grey, U and V are 128.
_YUV = ((0.299, 0.587, 0.114), (-0.147108, -0.288804, 0.435912), (0.614777, -0.514799, -0.099978))
_RGB = ((1.0, 0.0, 1.140), (1.0, -0.395, -0.581), (1.0, 2.032, 0.0))


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
    # All edges at once: what a GPU waits for is the number of operations, not their size.
    rows = torch.arange(height, device=corners.device)[:, None]
    columns = torch.arange(width, device=corners.device)
    x1, y1 = corners[..., None, None].unbind(2)
    x2, y2 = x1.roll(-1, 1), y1.roll(-1, 1)
    across, down = x2 - x1, y2 - y1
    column = x1 + (rows - y1) * across / torch.where(down == 0, 1.0, down)
    row = y1 + (columns - x1) * down / torch.where(across == 0, 1.0, across)
    crossed = ((y1 > rows) != (y2 > rows)) & (columns < column)
    within = (rows - y1) * (rows - y2) <= 0
    between = (columns - x1) * (columns - x2) <= 0
    steep = down.abs() > across.abs()
    outline = steep & within & ((columns - column).abs() <= 0.5)
    outline |= ~steep & between & ((rows - row).abs() <= 0.5)
    return (crossed.sum(1) % 2 == 1) | outline.any(1)


def moved(images: Tensor, right: Tensor, down: Tensor, beyond: str = "border") -> Tensor:
    """Move each row to the right, and each image down.

    Args:
        images: images.
        right: columns to move each row, float32 [n, H] or [n, 1].
        down: rows to move each image, float32 [n].
        beyond: source of pixels outside the image: its `border`, as OpenCV's BORDER_REPLICATE, or
            its `reflection`, as BORDER_REFLECT_101.
    """
    height, width = images.shape[2:]
    columns = torch.arange(width, device=images.device, dtype=torch.float32)
    rows = torch.arange(height, device=images.device, dtype=torch.float32)
    x = columns[None, None, :] - right[:, :, None]
    y = rows[None, :, None] - down[:, None, None]
    shares = [2 * at / max(size - 1, 1) - 1 for at, size in ((x, width), (y, height))]
    grid = torch.stack(torch.broadcast_tensors(*shares), -1)
    return F.grid_sample(images, grid, "bilinear", padding_mode=beyond, align_corners=True)


def to_rgb(images: Tensor, colour: str) -> Tensor:
    """Convert a view's images to RGB as OpenCV does for 8 bits, but without rounding."""
    return _CONVERSIONS[colour][0](images) if colour in _CONVERSIONS else images


def from_rgb(images: Tensor, colour: str) -> Tensor:
    """Convert RGB to a view's colour as OpenCV does for 8 bits, but without rounding."""
    return _CONVERSIONS[colour][1](images) if colour in _CONVERSIONS else images


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


_CONVERSIONS: dict[str, tuple[Callable[[Tensor], Tensor], Callable[[Tensor], Tensor]]] = {
    "bgr": (lambda images: images.flip(1), lambda images: images.flip(1)),
    "yuv": (_rgb_of_yuv, _yuv_of_rgb),
    "yuv_old": (
        lambda images: _rgb_of_yuv(images).flip(1),
        lambda images: _yuv_of_rgb(images.flip(1)),
    ),
    "hsv": (_rgb_of_hsv, _hsv_of_rgb),
}
