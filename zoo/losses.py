"""Losses beyond those of torch: each takes and gives what `torch.nn.MSELoss` does."""

from torch import Tensor, nn


class SteeringWeightedMSE(nn.Module):
    """Squared error, each sample weighted by `1 + weight * |true steering|`.

    Bends are rare in a recording and matter most; weighting them is the smooth sibling of the
    straight-angle cap.
    """

    def __init__(self, weight: float = 4.0) -> None:
        super().__init__()
        self.weight = weight

    def forward(self, predicted: Tensor, true: Tensor) -> Tensor:
        """Return the loss of predicted and true outputs, float32 [N, outputs] each."""
        weights = 1.0 + self.weight * true[:, :1].abs()
        return (weights * (predicted - true).square()).sum() / (weights.sum() * true.shape[1])

    def divisor(self, true: Tensor) -> Tensor:
        """Return the weight of a batch, or of a rank's shard, in the loss of all."""
        return (1.0 + self.weight * true[:, :1].abs()).sum()
