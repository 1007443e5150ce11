"""Layers of Keras on images that torch lacks, for `zoo.models.sequential`.

Images are [N, C, H, W] between the layers, as torch needs them. Where a layer's output depends on
Keras' order of axes, usually [N, H, W, C], it changes to that order and back.
"""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

Pads = tuple[int, int, int, int]  # left, right, top, bottom, as in F.pad


class PaddedConv2d(nn.Conv2d):
    """A convolution that pads its input by other amounts on opposite sides."""

    pads: Pads = (0, 0, 0, 0)

    def forward(self, images: Tensor) -> Tensor:
        """Return the convolution of padded images."""
        return super().forward(F.pad(images, self.pads))


class PaddedMaxPool2d(nn.MaxPool2d):
    """A maximum pooling whose padding never is the maximum."""

    pads: Pads = (0, 0, 0, 0)

    def forward(self, images: Tensor) -> Tensor:
        """Return the maxima of padded images."""
        return super().forward(F.pad(images, self.pads, value=float("-inf")))


class PaddedAvgPool2d(nn.AvgPool2d):
    """A mean pooling whose padding does not count in the mean.

    Args:
        kernel, stride: rows and columns.
        pads: padding.
        size: rows and columns of the input.
    """

    def __init__(
        self, kernel: tuple[int, int], stride: tuple[int, int], pads: Pads, size: tuple[int, int]
    ) -> None:
        super().__init__(kernel, stride)
        self.pads = pads
        for name, length, side, step, before, after in (
            ("rows", size[0], kernel[0], stride[0], pads[2], pads[3]),
            ("columns", size[1], kernel[1], stride[1], pads[0], pads[1]),
        ):
            inside = F.pad(torch.ones(1, 1, length), (before, after))
            factors = 1 / F.avg_pool1d(inside, side, step)[0]
            self.register_buffer(name, factors.T if name == "rows" else factors, persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return the means of padded images."""
        return super().forward(F.pad(images, self.pads)) * self.rows * self.columns


class Crop(nn.Module):
    """A layer that removes rows and columns from the edges.

    Args:
        edges: number of rows or columns at the top, bottom, left and right.
        size: rows and columns of the output.
    """

    def __init__(self, edges: tuple[int, int, int, int], size: tuple[int, int]) -> None:
        super().__init__()
        self.top, self.bottom, self.left, self.right = edges
        self.rows, self.columns = size

    def forward(self, images: Tensor) -> Tensor:
        """Return the images without their edges."""
        images = images[:, :, self.top : self.top + self.rows]
        return images[:, :, :, self.left : self.left + self.columns]

    def extra_repr(self) -> str:
        """Return the settings that a printed network shows."""
        return f"{self.top}, {self.bottom}, {self.left}, {self.right}"


class Resize(nn.Module):
    """A layer that resizes images by one matrix for the rows and one for the columns.

    Args:
        shape: rows and columns of the input.
        size: rows and columns of the output.
        method: `linear` (TensorFlow 2), `linear_tf1` (TensorFlow 1, whose samples are half a
            pixel aside), `linear_corners` (TensorFlow 1's `align_corners=True`), `nearest`,
            `nearest_tf1` or `area`.
    """

    def __init__(self, shape: tuple[int, int], size: tuple[int, int], method: str) -> None:
        super().__init__()
        self.size, self.method = size, method
        rows, columns = (resize_matrix(*one, method) for one in zip(shape, size, strict=True))
        self.register_buffer("rows", rows, persistent=False)
        self.register_buffer("columns", columns.T.contiguous(), persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return the resized images."""
        return self.rows.to(images.dtype) @ images @ self.columns.to(images.dtype)

    def extra_repr(self) -> str:
        """Return the settings that a printed network shows."""
        return f"{self.size[0]}, {self.size[1]}, {self.method}"


RESIZE_METHODS = ("linear", "linear_tf1", "linear_corners", "nearest", "nearest_tf1", "area")


def resize_matrix(length: int, size: int, method: str) -> Tensor:
    """Return a matrix [size, length] that resizes a column of pixels.

    >>> resize_matrix(4, 2, "area").tolist()
    [[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]]
    >>> resize_matrix(3, 2, "linear_corners").tolist()
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    matrix = torch.empty(size, length).zero_()  # `make_network` counts what `empty` allocates
    step, at = length / size, torch.arange(size, dtype=torch.float64)
    if method == "area":
        edges = torch.arange(length, dtype=torch.float64)
        for row in range(size):
            covered = (edges + 1).clamp(max=(row + 1) * step) - edges.clamp(min=row * step)
            matrix[row] = (covered.clamp(min=0) / step).float()
        return matrix
    old = method.endswith(("_tf1", "_corners"))
    if method == "linear_corners":
        step = (length - 1) / max(size - 1, 1)
    if method.startswith("nearest"):
        source = (at * step if old else (at + 0.5) * step).floor().clamp(max=length - 1)
        matrix[torch.arange(size), source.long()] = 1
        return matrix
    source = (at * step if old else (at + 0.5) * step - 0.5).clamp(0, length - 1)
    low = source.floor()
    share = (source - low).float()
    matrix[torch.arange(size), low.long()] += 1 - share
    matrix[torch.arange(size), (low.long() + 1).clamp(max=length - 1)] += share
    return matrix


class Gray(nn.Module):
    """A layer that weighs the channels, as `tf.image.rgb_to_grayscale`."""

    def __init__(self, weights: list[float]) -> None:
        super().__init__()
        self.register_buffer("weights", torch.tensor(weights)[:, None, None], persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return images of one channel."""
        return (images * self.weights.to(images.dtype)).sum(1, keepdim=True)


class InKerasOrder(nn.Module):
    """A layer for tensors in Keras' order of axes, [N, H, W, C] for images.

    Args:
        layer: layer that takes and returns this order.
    """

    def __init__(self, layer: nn.Module) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, values: Tensor) -> Tensor:
        """Return the layer's output."""
        if values.ndim == 4:
            values = values.permute(0, 2, 3, 1)
        values = self.layer(values)
        return values.permute(0, 3, 1, 2) if values.ndim == 4 else values


class OnAxis(nn.Module):
    """A layer that works on axis 1, applied to another axis of torch's order."""

    def __init__(self, layer: nn.Module, axis: int) -> None:
        super().__init__()
        self.layer, self.axis = layer, axis

    def forward(self, values: Tensor) -> Tensor:
        """Return the layer's output, with the axes of the input."""
        return self.layer(values.transpose(1, self.axis)).transpose(1, self.axis)


class Permute(nn.Module):
    """A layer that exchanges axes; axis 0 is the batch."""

    def __init__(self, axes: tuple[int, ...]) -> None:
        super().__init__()
        self.axes = axes

    def forward(self, values: Tensor) -> Tensor:
        """Return the values with exchanged axes."""
        return values.permute(0, *self.axes)
