"""Losses that torch lacks, called as `torch.nn.MSELoss`.

A loss that is no mean over samples, or needs more than the true outputs, has
`zoo.models.network_facts.LossFacts`.
"""

import torch
from torch import Tensor, nn

from zoo.models.network_facts import LossFacts


class SteeringWeightedMSE(nn.Module):
    """A mean squared error that weights each sample by `1 + weight * |true steering|`.

    Bends are rare in a recording and matter most. The weights do smoothly what
    `data.straight_cap` does with a threshold.
    """

    def __init__(self, weight: float = 4.0) -> None:
        super().__init__()
        self.weight = weight
        self.facts = LossFacts(divisor=self.divisor)

    def forward(self, predicted: Tensor, true: Tensor) -> Tensor:
        """Return the loss of a batch, both [N, outputs], as a scalar."""
        weights = 1.0 + self.weight * true[:, :1].abs()
        return (weights * (predicted - true).square()).sum() / (weights.sum() * true.shape[1])

    def divisor(self, true: Tensor) -> Tensor:
        """Return the sum of a batch's weights, by which the ranks' losses are averaged."""
        return (1.0 + self.weight * true[:, :1].abs()).sum()


class GaussianNLL(nn.Module):
    """The negative log likelihood of the true steering under a normal distribution.

    Source: Nix and Weigend 1994, "Estimating the mean and variance of the target probability
    distribution". The constant log(2 pi) / 2 is left out, so the loss can be negative. A throttle
    counts with half of its squared error.
    """

    facts = LossFacts(needs_spread=True)

    def forward(self, predicted: Tensor, true: Tensor) -> Tensor:
        """Return the loss of a batch as a scalar.

        Args:
            predicted: means, and the logarithm of the steering's spread, [N, outputs + 1].
            true: recorded steering (and throttle), [N, outputs].
        """
        log_spread = predicted[:, -1]
        squared = (predicted[:, :-1] - true).square()
        steering = log_spread + squared[:, 0] * torch.exp(-2 * log_spread) / 2
        return (steering + squared[:, 1:].sum(1) / 2).mean()
