"""Layers of Keras on single values that torch lacks, for `zoo.models.sequential`."""

from collections.abc import Callable
from functools import partial

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from zoo.models.image_layers import InKerasOrder


class Select(nn.Module):
    """A layer that returns some columns of its input."""

    def __init__(self, columns: list[int]) -> None:
        super().__init__()
        self.columns = columns

    def forward(self, values: Tensor) -> Tensor:
        """Return the columns, [N, columns]."""
        return torch.stack([values[:, column] for column in self.columns], dim=1)


class Unbin(nn.Module):
    """A layer that returns a number for each group of bins: that of the bin of the largest value.

    In training, its gradient is that of the mean of all bins' numbers, weighed by their softmax
    (straight-through estimator: Bengio et al., 2013, arXiv:1308.3432).

    Args:
        bins: number of bins of each group.
        lows: number of each group's first bin.
        steps: difference between two bins of each group.
    """

    def __init__(self, bins: list[int], lows: list[float], steps: list[float]) -> None:
        super().__init__()
        self.groups = list(zip(bins, lows, steps, strict=True))

    def forward(self, values: Tensor) -> Tensor:
        """Return the numbers, [N, groups], for values [N, bins of all groups]."""
        numbers = []
        for group, (bins, low, step) in zip(
            values.split([one[0] for one in self.groups], dim=1), self.groups, strict=True
        ):
            number = group.argmax(1).to(values.dtype)
            if self.training:
                places = torch.arange(bins, dtype=values.dtype, device=values.device)
                mean = group.softmax(1) @ places
                number = number + mean - mean.detach()
            numbers.append(low + step * number)
        return torch.stack(numbers, dim=1)


class Rescaling(nn.Module):
    """A layer that multiplies each channel by a factor and adds an offset."""

    def __init__(self, scale: Tensor, offset: Tensor) -> None:
        super().__init__()
        self.register_buffer("scale", scale, persistent=False)
        self.register_buffer("offset", offset, persistent=False)

    def forward(self, values: Tensor) -> Tensor:
        """Return the scaled values."""
        return values * self.scale.to(values.dtype) + self.offset.to(values.dtype)


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
    """A layer that adds noise in training mode."""

    def __init__(self, deviation: float) -> None:
        super().__init__()
        self.deviation = deviation

    def forward(self, values: Tensor) -> Tensor:
        """Return the values with noise."""
        noise = self.deviation * torch.randn_like(values) if self.training else 0
        return values + noise


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
