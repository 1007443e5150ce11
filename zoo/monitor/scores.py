"""Scores of frames by several methods; a high score is a frame unlike those of nominal drives.

The autoencoder is that of SelfOracle, Stocco et al. 2020, "Misbehaviour prediction for autonomous
driving systems", arXiv:1910.04443: frames unlike those of nominal drives are reconstructed badly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy import stats
from torch import Tensor, nn

from zoo.base.errors import InputError
from zoo.monitor.signals import DROPOUT, ENSEMBLE, IMAGE, IMAGE_SIZE, MAP, MAP_SIZE, SPREAD

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


# Shapes of the images of autoencoders: channels, height, width.
SHAPES = ((3, *IMAGE_SIZE[::-1]), (1, *MAP_SIZE[::-1]))


LEAST_WINDOWS = 20  # of a threshold


@dataclass(frozen=True)
class Score:
    """A fitted method.

    Attributes:
        method: key of METHODS.
        state: values that the fit found, as plain containers and tensors.
        function: function of the signals of consecutive frames, [N, ...], that returns the score
            of each, float64 [N].
    """

    method: str
    state: dict[str, Any]
    function: Callable[[np.ndarray], np.ndarray]

    def __call__(self, signals: np.ndarray) -> np.ndarray:
        """Return the score of each of the consecutive frames, float64 [N]."""
        return self.function(signals)


@dataclass(frozen=True)
class Method:
    """A method that scores frames.

    Attributes:
        signal: name of the signal that it needs.
        fit: function of nominal signals [N, ...] and a number of epochs that returns the state.
        make: function of the state that returns `Score.function`.
        frames: consecutive frames that a score needs.
        source: publication.
    """

    signal: str
    fit: Callable[[np.ndarray, int], dict[str, Any]]
    make: Callable[[dict[str, Any]], Callable[[np.ndarray], np.ndarray]]
    source: str
    frames: int = 1


def _fit_autoencoder(signals: np.ndarray, epochs: int) -> dict[str, Any]:
    network = train_autoencoder(signals, epochs)
    return {"shape": list(network.shape), "weights": dict(network.state_dict())}


def _autoencoder(state: dict[str, Any]) -> Callable[[np.ndarray], np.ndarray]:
    shape = tuple(state["shape"])
    if shape not in SHAPES:  # a file of another person could fill the memory
        raise ValueError(f"shape {shape!s:.40} is none of {SHAPES}")
    network = Autoencoder(shape).eval()
    network.load_state_dict(state["weights"])
    if not all(torch.isfinite(one).all() for one in network.parameters()):
        raise ValueError("a weight is not finite")

    @torch.inference_mode()
    def errors(images: np.ndarray) -> np.ndarray:
        parts = torch.from_numpy(np.ascontiguousarray(images)).split(256)
        return torch.cat([network(one) for one in parts]).numpy().astype(float)

    return errors


def _distance(state: dict[str, Any]) -> Callable[[np.ndarray], np.ndarray]:
    mean = float(state["mean"])
    return lambda signals: np.abs(_levels(signals) - mean)


def _levels(signals: np.ndarray) -> np.ndarray:
    return signals.reshape(len(signals), -1).mean(1) / 255


def _changes(signals: np.ndarray) -> np.ndarray:
    flat = signals.reshape(len(signals), -1) / 255
    return np.abs(np.diff(flat, axis=0, prepend=flat[:1])).mean(1)


def _nothing(signals: np.ndarray, epochs: int) -> dict[str, Any]:
    return {}


SELFORACLE = "SelfOracle, Stocco et al. 2020"
THIRDEYE = "ThirdEye, Stocco et al. 2022"
GREWAL = "Grewal et al. 2024"
METHODS = {
    "autoencoder": Method(IMAGE, _fit_autoencoder, _autoencoder, SELFORACLE),
    # Published: the mean itself; here its distance from the nominal mean, since fog lowers it.
    "attention_mean": Method(
        MAP,
        lambda signals, epochs: {"mean": float(_levels(signals).mean())},
        _distance,
        THIRDEYE,
    ),
    "attention_change": Method(MAP, _nothing, lambda state: _changes, THIRDEYE, frames=2),
    "attention_autoencoder": Method(MAP, _fit_autoencoder, _autoencoder, THIRDEYE),
    "dropout": Method(DROPOUT, _nothing, lambda state: np.asarray, GREWAL),
    "spread": Method(SPREAD, _nothing, lambda state: np.asarray, GREWAL),
    "ensemble": Method(ENSEMBLE, _nothing, lambda state: np.asarray, GREWAL),
}


def fit_score(method: str, signals: np.ndarray, epochs: int) -> Score:
    """Fit a method to the signals of nominal frames.

    Args:
        method: key of METHODS.
        signals: signals of the frames, [N, ...].
        epochs: passes of the training of an autoencoder.
    """
    return make_score(method, METHODS[method].fit(signals, epochs))


def make_score(method: str, state: dict[str, Any]) -> Score:
    """Return a fitted method from its state."""
    return Score(method, state, METHODS[method].make(state))


@dataclass(frozen=True)
class Threshold:
    """A Gamma distribution of nominal windows' scores, and the threshold at a false-alarm rate.

    Attributes:
        shape: shape of the distribution.
        scale: scale of the distribution.
        false_alarms: share of nominal windows above the threshold, by the distribution.
        value: score above which a window raises an alarm.
    """

    shape: float
    scale: float
    false_alarms: float
    value: float


def fit_threshold(scores: np.ndarray, false_alarms: float) -> Threshold:
    """Fit a Gamma distribution that begins at 0 by maximum likelihood.

    Source: Stocco et al. 2020, arXiv:1910.04443, section 4.4.

    Args:
        scores: scores of nominal windows, float [N], 0 or more.
        false_alarms: share of nominal windows that may raise an alarm, between 0 and 1.

    Raises:
        InputError: there are too few scores, or all are equal.

    >>> scores = stats.gamma(3, scale=2).rvs(4000, random_state=0)
    >>> round(fit_threshold(scores, 0.05).value, 1)  # the distribution's own: 12.6
    12.4
    """
    if len(scores) < LEAST_WINDOWS:
        raise InputError(
            f"{len(scores)} nominal windows: a threshold needs {LEAST_WINDOWS} or more; drive more "
            "nominal_laps= or nominal= drives, or choose a network that fails less"
        )
    if not np.isfinite(scores).all() or np.ptp(scores) == 0:
        raise InputError("the nominal scores are all equal or not finite; leave the method out")
    positive = np.maximum(scores, 1e-12)  # the likelihood of 0 is 0
    shape, _, scale = stats.gamma.fit(positive, floc=0)
    value = float(stats.gamma.ppf(1 - false_alarms, shape, scale=scale))
    return Threshold(float(shape), float(scale), false_alarms, value)
