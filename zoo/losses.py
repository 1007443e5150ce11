"""Losses that torch lacks, with the inputs and output of `torch.nn.MSELoss`."""

from torch import Tensor, nn


class SteeringWeightedMSE(nn.Module):
    """A mean squared error that weights each sample by `1 + weight * |true steering|`.

    Bends are rare in a recording and matter most. The weights do smoothly what
    `data.straight_cap` does with a threshold.
    """

    def __init__(self, weight: float = 4.0) -> None:
        super().__init__()
        self.weight = weight

    def forward(self, predicted: Tensor, true: Tensor) -> Tensor:
        """Return the loss of a batch, both [N, outputs], as a scalar."""
        weights = 1.0 + self.weight * true[:, :1].abs()
        return (weights * (predicted - true).square()).sum() / (weights.sum() * true.shape[1])

    def divisor(self, true: Tensor) -> Tensor:
        """Return the sum of a batch's weights, by which the ranks' losses are averaged."""
        return (1.0 + self.weight * true[:, :1].abs()).sum()
