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
    # Of each edge and row, the columns where it changes sides and those of its outline: what is as
    # large as all pixels of all edges is compared only.
    rows = torch.arange(height, device=corners.device, dtype=torch.float32)
    columns = torch.arange(width, device=corners.device, dtype=torch.float32)
    x1, y1 = corners[..., None].unbind(2)
    x2, y2 = x1.roll(-1, 1), y1.roll(-1, 1)
    across, down = x2 - x1, y2 - y1
    by = torch.where(down == 0, 1.0, down)
    column = x1 + (rows - y1) * across / by
    crossing = torch.where((y1 > rows) != (y2 > rows), column, -1.0)
    # A steep edge has a pixel in each row; another the pixels whose row is nearest.
    ends = x1 + (rows - 0.5 - y1) * across / by, x1 + (rows + 0.5 - y1) * across / by
    left, right = torch.minimum(*ends), torch.maximum(*ends)
    flat = (down == 0) & (rows == y1)
    left = torch.where(down == 0, torch.where(flat, -1.0, width), left)
    right = torch.where(down == 0, torch.where(flat, width, -1.0), right)
    steep = down.abs() > across.abs()
    within = (rows - y1) * (rows - y2) <= 0
    first, last = left.maximum(x1.minimum(x2)), right.minimum(x1.maximum(x2))
    left = torch.where(steep, torch.where(within, column - 0.5, width), first)
    right = torch.where(steep, column + 0.5, last)
    outline = (columns >= left[..., None]) & (columns <= right[..., None])
    return ((columns < crossing[..., None]).sum(1, dtype=torch.uint8) % 2 == 1) | outline.any(1)


def moved(images: Tensor, right: Tensor, down: Tensor, beyond: str = "border") -> Tensor:
    """Move each row to the right, and each image down.

    Args:
        images: images.
        right: columns to move each row, float32 [n, H] or [n, 1].
        down: rows to move each image, float32 [n].
        beyond: source of pixels outside the image: its `border`, as OpenCV's BORDER_REPLICATE, or
            its `reflection`, as BORDER_REFLECT_101.
    """
    (count, _, height, width), device = images.shape, images.device
    # In the unit of grid_sample, in which an image reaches from -1 to 1.
    columns = torch.linspace(-1, 1, width, device=device)
    rows = torch.linspace(-1, 1, height, device=device)[:, None]
    grid = torch.empty((count, height, width, 2), device=device)
    grid[..., 0] = columns - (right * (2 / max(width - 1, 1)))[:, :, None]
    grid[..., 1] = rows - (down * (2 / max(height - 1, 1)))[:, None, None]
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
    centres = hue.new_tensor([0.0, 60.0, 120.0])[:, None, None]
    away = ((hue[:, None] - centres + 90) % 180 - 90).abs()
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
    rows = [sum(w * channel for w, channel in zip(row, channels, strict=True)) for row in matrix]
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
