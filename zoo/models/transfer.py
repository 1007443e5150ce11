"""Transfer: a network of pretrained convolutions, some of them frozen, and a head that steers."""

from itertools import islice

from torch import Tensor, nn

from zoo.models.layers import activation_layer, feature_shape, in_pieces
from zoo.models.network_facts import NetworkFacts


class Transfer(nn.Module):
    """Convolutions whose first layers can be frozen, with a regression head.

    A subclass names its public ImageNet weights: `imagenet_source` is the address of a file, or
    `PACKAGE/PATH` of a file in an installed package; the name of the file ends with the first eight
    digits of its SHA-256. `public_state` gives its tensors the names of the network.

    Args:
        shape: `(3, height, width)` of the view, RGB.
        normalize: layer that scales pixels 0..255.
        features: convolutions.
        frozen_layers: number of frozen layers of `features`, counted from the first.
        activation: `elu` or `relu`, in the head.
        dropout: rate before the output.
        units: number of units in the head's hidden layer.
        reduce: layers between `features` and the head; None for none.
    """

    published_name: str
    imagenet_source: str

    def __init__(
        self,
        shape: tuple[int, int, int],
        normalize: nn.Module,
        features: nn.Sequential,
        frozen_layers: int,
        activation: str,
        dropout: float,
        units: int,
        reduce: nn.Module | None = None,
    ) -> None:
        super().__init__()
        name = type(self).__name__
        if shape[0] != 3:
            raise ValueError(f"{name} takes 3 channels, not {shape[0]}: set model.colour=rgb")
        self._frozen_layers = frozen_layers
        self.normalize = normalize
        self.features = features
        self.reduce = reduce
        features[:frozen_layers].requires_grad_(False)
        layers = features if reduce is None else nn.Sequential(features, reduce)
        self.head = nn.Sequential(
            nn.Linear(feature_shape(layers, shape, name).numel(), units),
            activation_layer(activation),
            nn.Dropout(dropout),
            nn.Linear(units, 1),
        )
        self.train()

    @staticmethod
    def public_state(state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Return the tensors of the public weights that `features` takes, under their names."""
        raise NotImplementedError

    def train(self, mode: bool = True) -> "Transfer":
        """Set the training mode; frozen layers keep the mode that evaluates.

        Batch normalization would otherwise change the statistics of frozen layers.
        """
        super().train(mode)
        self.features[: self._frozen_layers].eval()
        return self

    @property
    def facts(self) -> NetworkFacts:
        """The frozen layers, if any; the backbone is all convolutions."""
        frozen = self.features[: self._frozen_layers]
        front = nn.Sequential(self.normalize, *frozen.children()) if self._frozen_layers else None
        return NetworkFacts(frozen_front=front, backbone=self.features)

    def front(self, images: Tensor) -> Tensor:
        """Return the features [N, c, h, w] of the frozen layers."""
        features = self.normalize(images)
        for layer in islice(self.features, self._frozen_layers):
            features = layer(features)
        return features

    def rest(self, features: Tensor) -> Tensor:
        """Return the steering [N, 1] for the frozen layers' features, of any float dtype."""
        features = features.to(next(self.head.parameters()).dtype)
        for layer in islice(self.features, self._frozen_layers, None):
            features = layer(features)
        if self.reduce is not None:
            features = self.reduce(features)
        return self.head(features.flatten(1))

    def forward(self, images: Tensor) -> Tensor:
        """Return the steering [N, 1] for images [N, 3, H, W]."""
        # Not in evaluation, whose batches come in pieces, and whose graph is exported.
        is_frozen = self.training and self._frozen_layers
        return self.rest(in_pieces(self.front, images) if is_frozen else self.front(images))


def check_trainable_blocks(trainable_blocks: object, blocks: int) -> None:
    """Raise ValueError if a network of `blocks` blocks cannot train that number of them."""
    if trainable_blocks not in range(blocks + 1):
        raise ValueError(
            f"model.trainable_blocks={trainable_blocks}: set a number from 0 to {blocks}"
        )
