"""A small convolutional autoencoder whose reconstruction error is the score of an image.

After SelfOracle, Stocco et al. 2020, "Misbehaviour prediction for autonomous driving systems",
arXiv:1910.04443: frames unlike those of nominal drives are reconstructed badly.
"""

import numpy as np
import torch
from torch import Tensor, nn

CODE, CHANNELS = 32, (16, 32, 32)
BATCH, LEARNING_RATE = 64, 1e-3


class Autoencoder(nn.Module):
    """Convolutional autoencoder of small images.

    Args:
        shape: `(channels, height, width)`; height and width are multiples of 8.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        super().__init__()
        self.shape = tuple(shape)
        channels, height, width = shape
        if height % 8 or width % 8:
            raise ValueError(f"{height} x {width} pixels: must be multiples of 8")
        first, second, third = CHANNELS
        inner = (third, height // 8, width // 8)
        units = third * height * width // 64
        self.encode = nn.Sequential(
            nn.Conv2d(channels, first, 3, 2, 1),
            nn.ReLU(),
            nn.Conv2d(first, second, 3, 2, 1),
            nn.ReLU(),
            nn.Conv2d(second, third, 3, 2, 1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(units, CODE),
        )
        self.decode = nn.Sequential(
            nn.Linear(CODE, units),
            nn.ReLU(),
            nn.Unflatten(1, inner),
            nn.ConvTranspose2d(third, second, 4, 2, 1),
            nn.ReLU(),
            nn.ConvTranspose2d(second, first, 4, 2, 1),
            nn.ReLU(),
            nn.ConvTranspose2d(first, channels, 4, 2, 1),
        )

    def forward(self, images: Tensor) -> Tensor:
        """Return the mean squared error of each image's reconstruction, float [N].

        Args:
            images: uint8 [N, height, width, channels].
        """
        wanted = images.permute(0, 3, 1, 2).float() / 255
        return (self.decode(self.encode(wanted)) - wanted).square().mean((1, 2, 3))


def train_autoencoder(images: np.ndarray, epochs: int, seed: int = 0) -> Autoencoder:
    """Train an autoencoder on images of nominal drives.

    Args:
        images: uint8 [N, height, width, channels].
        epochs: passes over the images.
        seed: random seed of weights and order.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        count, height, width, channels = images.shape
        network = Autoencoder((channels, height, width))
        optimizer = torch.optim.Adam(network.parameters(), LEARNING_RATE)
        for _ in range(epochs):
            for rows in torch.randperm(count).split(BATCH):
                optimizer.zero_grad()
                network(torch.from_numpy(images[rows.numpy()])).mean().backward()
                optimizer.step()
    return network.eval()


@torch.inference_mode()
def reconstruction_errors(network: Autoencoder, images: np.ndarray) -> np.ndarray:
    """Return the error of each image, float64 [N]; see `Autoencoder.forward`."""
    parts = torch.from_numpy(np.ascontiguousarray(images)).split(256)
    return torch.cat([network(one) for one in parts]).numpy().astype(float)
