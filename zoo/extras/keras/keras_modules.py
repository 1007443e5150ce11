"""Layers of Keras that torch lacks, for `zoo.extras.keras.layer_chain`.

Images are [N, C, H, W] between the layers, as torch needs them. Where a layer's output depends on
Keras' order of axes, usually [N, H, W, C], it changes to that order and back.
"""

from collections.abc import Callable
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

Pads = tuple[int, int, int, int]  # left, right, top, bottom, as in F.pad


class Lambda(nn.Module):
    """A layer of a function, without weights."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        super().__init__()
        self.function = function

    def forward(self, values: Tensor) -> Tensor:
        """Return the function's values."""
        return self.function(values)


class PaddedConv2d(nn.Conv2d):
    """A convolution that pads its input by other amounts on opposite sides."""

    def __init__(self, pads: Pads, *settings: Any) -> None:
        super().__init__(*settings)
        self.pads = pads

    def forward(self, images: Tensor) -> Tensor:
        """Return the convolution of padded images."""
        return super().forward(F.pad(images, self.pads))


class Resize(nn.Module):
    """A layer that resizes images by one matrix for the rows and one for the columns.

    Args:
        shape: rows and columns of the input.
        size: rows and columns of the output.
        method: `linear` (TensorFlow 2), `linear_tf1` (TensorFlow 1, whose samples are half a
            pixel aside), `linear_corners` (TensorFlow 1's `align_corners=True`), `nearest`,
            `nearest_tf1` or `area`.
    """

    rows: Tensor
    columns: Tensor

    def __init__(self, shape: tuple[int, int], size: tuple[int, int], method: str) -> None:
        super().__init__()
        self.size, self.method = size, method
        rows, columns = (resize_matrix(*sides, method) for sides in zip(shape, size, strict=True))
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


class OnAxis(nn.Module):
    """A layer that works on axis 1, applied to another axis of torch's order."""

    def __init__(self, layer: nn.Module, axis: int) -> None:
        super().__init__()
        self.layer, self.axis = layer, axis

    def forward(self, values: Tensor) -> Tensor:
        """Return the layer's output, with the axes of the input."""
        return self.layer(values.transpose(1, self.axis)).transpose(1, self.axis)


class BatchNorm(nn.Module):
    """A batch normalization over axis 1; a batch with one value uses the saved statistics.

    Args:
        features: length of axis 1.
        epsilon: number added to the variance.
        momentum: share of the saved statistics that each batch keeps, as in Keras.
        center, scale: whether its offset and its factor are trained.
    """

    running_mean: Tensor
    running_var: Tensor

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


class GaussianNoise(nn.Module):
    """A layer that adds noise in training mode."""

    def __init__(self, deviation: float) -> None:
        super().__init__()
        self.deviation = deviation

    def forward(self, values: Tensor) -> Tensor:
        """Return the values with noise."""
        noise = self.deviation * torch.randn_like(values) if self.training else 0
        return values + noise


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
    "softmax": nn.Softmax,  # `spec_builders` names its axis
    "hard_sigmoid": lambda: Lambda(lambda x: (0.2 * x + 0.5).clamp(0, 1)),  # of Keras 1 and 2
    "exponential": lambda: Lambda(torch.exp),
    "atan": lambda: Lambda(torch.atan),
}
