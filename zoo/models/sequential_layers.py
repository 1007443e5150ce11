"""Layers of Keras that torch lacks, for `zoo.models.sequential`.

Images are [N, C, H, W] between the layers, as torch needs them. Where a layer's output depends on
Keras' order of axes, usually [N, H, W, C], it changes to that order and back.
"""

from collections.abc import Callable
from functools import partial

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
            pixel aside), `nearest`, `nearest_tf1` or `area`.
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


RESIZE_METHODS = ("linear", "linear_tf1", "nearest", "nearest_tf1", "area")


def resize_matrix(length: int, size: int, method: str) -> Tensor:
    """Return a matrix [size, length] that resizes a column of pixels.

    >>> resize_matrix(4, 2, "area").tolist()
    [[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]]
    """
    matrix = torch.empty(size, length).zero_()  # `make_network` counts what `empty` allocates
    step, at = length / size, torch.arange(size, dtype=torch.float64)
    if method == "area":
        edges = torch.arange(length, dtype=torch.float64)
        for row in range(size):
            covered = (edges + 1).clamp(max=(row + 1) * step) - edges.clamp(min=row * step)
            matrix[row] = (covered.clamp(min=0) / step).float()
        return matrix
    old = method.endswith("_tf1")
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


class InKerasOrder(nn.Module):
    """A layer for tensors in Keras' order of axes, [N, H, W, C] for images.

    Args:
        layer: layer that takes and returns this order.
        to_images: whether an output of 4 axes becomes [N, C, H, W] again.
    """

    def __init__(self, layer: nn.Module, to_images: bool = True) -> None:
        super().__init__()
        self.layer, self.to_images = layer, to_images

    def forward(self, values: Tensor) -> Tensor:
        """Return the layer's output."""
        if values.ndim == 4:
            values = values.permute(0, 2, 3, 1)
        values = self.layer(values)
        return values.permute(0, 3, 1, 2) if values.ndim == 4 and self.to_images else values


class OnAxis(nn.Module):
    """A layer that works on axis 1, applied to another axis of torch's order."""

    def __init__(self, layer: nn.Module, axis: int) -> None:
        super().__init__()
        self.layer, self.axis = layer, axis

    def forward(self, values: Tensor) -> Tensor:
        """Return the layer's output, with the axes of the input."""
        return self.layer(values.transpose(1, self.axis)).transpose(1, self.axis)


class Reshape(nn.Module):
    """A layer that changes the shape of each sample."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        super().__init__()
        self.shape = shape

    def forward(self, values: Tensor) -> Tensor:
        """Return the values in the new shape."""
        return values.reshape(-1, *self.shape)


class Permute(nn.Module):
    """A layer that exchanges axes; axis 0 is the batch."""

    def __init__(self, axes: tuple[int, ...]) -> None:
        super().__init__()
        self.axes = axes

    def forward(self, values: Tensor) -> Tensor:
        """Return the values with exchanged axes."""
        return values.permute(0, *self.axes)


class Select(nn.Module):
    """A layer that returns some columns of its input."""

    def __init__(self, columns: list[int]) -> None:
        super().__init__()
        self.columns = columns

    def forward(self, values: Tensor) -> Tensor:
        """Return the columns, [N, columns]."""
        return torch.stack([values[:, column] for column in self.columns], dim=1)


class OverRows(nn.Module):
    """A layer for images, applied to sequences [N, steps, channels] as one row of pixels."""

    def __init__(self, layer: nn.Module) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, values: Tensor) -> Tensor:
        """Return the layer's output, [N, steps, channels]."""
        return self.layer(values.transpose(1, 2)[:, :, None])[:, :, 0].transpose(1, 2)


class Rescaling(nn.Module):
    """A layer that multiplies each channel by a factor and adds an offset."""

    def __init__(self, scale: Tensor, offset: Tensor) -> None:
        super().__init__()
        self.register_buffer("scale", scale, persistent=False)
        self.register_buffer("offset", offset, persistent=False)

    def forward(self, values: Tensor) -> Tensor:
        """Return the scaled values."""
        return values * self.scale.to(values.dtype) + self.offset.to(values.dtype)


class Gray(nn.Module):
    """A layer that weighs the channels, as `tf.image.rgb_to_grayscale`."""

    def __init__(self, weights: list[float]) -> None:
        super().__init__()
        self.register_buffer("weights", torch.tensor(weights)[:, None, None], persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return images of one channel."""
        return (images * self.weights.to(images.dtype)).sum(1, keepdim=True)


class GlobalPool(nn.Module):
    """A layer that returns the mean or maximum of each channel."""

    def __init__(self, maximum: bool, keep: bool) -> None:
        super().__init__()
        self.maximum, self.keep = maximum, keep

    def forward(self, images: Tensor) -> Tensor:
        """Return [N, C], or [N, C, 1, 1] with `keep`."""
        pool = torch.amax if self.maximum else torch.mean
        return pool(images, (2, 3), keepdim=self.keep)


class BatchNorm(nn.Module):
    """A batch normalization over axis 1; a batch with one value uses the saved statistics.

    Args:
        features: length of axis 1.
        epsilon: number added to the variance.
        momentum: share of the saved statistics that each batch keeps, as in Keras.
        center, scale: whether its offset and its factor are trained.
    """

    def __init__(
        self, features: int, epsilon: float, momentum: float, center: bool, scale: bool
    ) -> None:
        super().__init__()
        self.epsilon, self.momentum = epsilon, momentum
        self.weight = nn.Parameter(torch.empty(features).fill_(1), requires_grad=scale)
        self.bias = nn.Parameter(torch.empty(features).zero_(), requires_grad=center)
        self.register_buffer("running_mean", torch.empty(features).zero_())
        self.register_buffer("running_var", torch.empty(features).fill_(1))

    def forward(self, values: Tensor) -> Tensor:
        """Return normalized values."""
        training = self.training and values.numel() > values.shape[1]
        return F.batch_norm(
            values,
            self.running_mean,
            self.running_var,
            self.weight,
            self.bias,
            training,
            1 - self.momentum,
            self.epsilon,
        )


class PReLU(nn.Module):
    """A ReLU whose slope below 0 is trained, one for each value or shared along axes."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        super().__init__()
        self.alpha = nn.Parameter(torch.empty(shape).zero_())

    def forward(self, values: Tensor) -> Tensor:
        """Return positive values, and negative ones times their slope."""
        return values.clamp(min=0) + self.alpha * values.clamp(max=0)


class GeneralReLU(nn.Module):
    """Keras' ReLU with a threshold, a slope below it, and a largest value."""

    def __init__(self, slope: float, threshold: float, most: float | None) -> None:
        super().__init__()
        self.slope, self.threshold, self.most = slope, threshold, most

    def forward(self, values: Tensor) -> Tensor:
        """Return the values after the ReLU."""
        below = self.slope * (values - self.threshold)
        out = torch.where(values >= self.threshold, values, below)
        return out if self.most is None else torch.where(values >= self.most, self.most, out)


class GaussianNoise(nn.Module):
    """A layer that adds noise, or multiplies by it, in training mode."""

    def __init__(self, deviation: float, multiplies: bool) -> None:
        super().__init__()
        self.deviation, self.multiplies = deviation, multiplies

    def forward(self, values: Tensor) -> Tensor:
        """Return the values with noise."""
        if not self.training:
            return values
        noise = self.deviation * torch.randn_like(values)
        return values * (1 + noise) if self.multiplies else values + noise


class Function(nn.Module):
    """A layer of a function that torch has no layer for; `name` is a key of `FUNCTIONS`."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name

    def forward(self, values: Tensor) -> Tensor:
        """Return the function's values."""
        return FUNCTIONS[self.name](values)

    def extra_repr(self) -> str:
        """Return the settings that a printed network shows."""
        return self.name


FUNCTIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "hard_sigmoid": lambda x: (0.2 * x + 0.5).clamp(0, 1),  # of Keras 1 and 2
    "exponential": torch.exp,
    "atan": torch.atan,
}
ACTIVATIONS: dict[str, Callable[[], nn.Module]] = {
    "linear": nn.Identity,
    "relu": nn.ReLU,
    "relu6": nn.ReLU6,
    "elu": nn.ELU,
    "selu": nn.SELU,
    "tanh": nn.Tanh,
    "sigmoid": nn.Sigmoid,
    "softplus": nn.Softplus,
    "softsign": nn.Softsign,
    "swish": nn.SiLU,
    "hard_sigmoid_3": nn.Hardsigmoid,  # of Keras 3
    "hard_swish": nn.Hardswish,
    "mish": nn.Mish,
    "gelu": nn.GELU,
    "leaky_relu": lambda: nn.LeakyReLU(0.2),
    "softmax": lambda: InKerasOrder(nn.Softmax(-1)),
    **{name: partial(Function, name) for name in FUNCTIONS},
}
