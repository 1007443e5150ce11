"""Signals of a frame, from which its scores are computed."""

import copy
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import torch
from torch import nn

from datamodules.view import FRAME
from zoo.base.errors import InputError
from zoo.checkpoints.command import Command, Policy
from zoo.checkpoints.frozen_graph import network_inputs
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy import CheckpointPolicy
from zoo.saliency.visual_backprop import Saliency

IMAGE_SIZE, MAP_SIZE = (80, 40), (64, 16)  # width and height in pixels
IMAGE, MAP, DROPOUT, SPREAD, ENSEMBLE = "image", "map", "dropout", "spread", "ensemble"
SEED = 0  # of Monte-Carlo dropout

# Function of a frame, mph and the policy's command that returns the signal.
Source = Callable[[np.ndarray, float, Command], np.ndarray | float]


def make_source(name: str, policy: Policy, samples: int) -> Source:
    """Return the source of a policy's signal.

    Args:
        name: IMAGE, MAP, DROPOUT or SPREAD.
        policy: policy that drives.
        samples: number of passes of Monte-Carlo dropout for each frame.

    Raises:
        InputError: the policy has no such signal.
    """
    if name == IMAGE:
        return lambda frame, mph, command: small_image(frame)
    if name == MAP:
        return AttentionMap(policy)
    return DropoutSpread(policy, samples) if name == DROPOUT else command_spread(policy)


def signal_sources(
    policy: Policy, samples: int, ensemble: Sequence[Policy] = ()
) -> tuple[dict[str, Source], list[str]]:
    """Return the sources of signals that a policy has, and a line for each that it lacks.

    Args:
        policy: policy that drives.
        samples: see `make_source`.
        ensemble: further policies, whose steering is compared with the policy's.
    """
    sources: dict[str, Source] = {}
    lacking = []
    for name in (IMAGE, MAP, DROPOUT, SPREAD):
        try:
            sources[name] = make_source(name, policy, samples)
        except InputError as error:
            lacking.append(f"not scored: {name}: {error}")
    if ensemble:
        sources[ENSEMBLE] = EnsembleSpread(ensemble)
    return sources, lacking


def small_image(frame: np.ndarray) -> np.ndarray:
    """Return a camera frame, uint8 [H, W, 3], at 40 x 80 pixels."""
    return cv2.resize(frame, IMAGE_SIZE, interpolation=cv2.INTER_AREA)


class AttentionMap:
    """Saliency map of a frame, uint8 [16, 64, 1], of the rows that the network sees.

    Raises:
        InputError: the network has no saliency map.
    """

    def __init__(self, policy: Policy) -> None:
        if isinstance(policy, CheckpointPolicy) and policy.memory is not None:
            raise InputError("a network with memory has no map of one frame")
        if not isinstance(policy, CheckpointPolicy | OnnxPolicy):
            raise InputError("several networks have no common map")
        self._saliency = Saliency(policy)

    def __call__(self, frame: np.ndarray, mph: float, command: Command) -> np.ndarray:
        """Return the map of a frame."""
        top, bottom = self._saliency.view.rows_cropped(len(frame))
        seen = self._saliency(frame, mph)[top : len(frame) - bottom]
        small = cv2.resize(seen, MAP_SIZE, interpolation=cv2.INTER_AREA)
        return (255 * small).round().astype(np.uint8)[..., None]


class DropoutSpread:
    """Standard deviation of the steering under dropout.

    Source: Gal and Ghahramani 2016, "Dropout as a Bayesian approximation", arXiv:1506.02142. The
    same masks are drawn for every frame, so a change of the spread comes from the frame.

    Raises:
        InputError: the network has no dropout.
    """

    def __init__(self, policy: Policy, samples: int) -> None:
        if not isinstance(policy, CheckpointPolicy) or policy.memory is not None:
            raise InputError("needs a checkpoint of one network without memory")
        self._network, self._policy, self._samples = copy.deepcopy(policy.network), policy, samples
        layers = [one for one in self._network.modules() if isinstance(one, nn.Dropout) and one.p]
        if not layers:
            raise InputError(f"{policy.name} has no dropout")
        for one in layers:
            one.train()

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, mph: float, command: Command) -> float:
        """Return the spread of a frame."""
        takes_speed = self._policy.takes_speed
        inputs = network_inputs(self._policy.view(frame), mph if takes_speed else None)
        repeated = [one.repeat(self._samples, *[1] * (one.ndim - 1)) for one in inputs]
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(SEED)
            return float(self._network(*repeated)[:, 0].clamp(-1, 1).std())


class EnsembleSpread:
    """Standard deviation of the steering of several policies.

    Source: Lakshminarayanan et al. 2017, "Simple and scalable predictive uncertainty estimation
    using deep ensembles", arXiv:1612.01474.
    """

    def __init__(self, others: Sequence[Policy]) -> None:
        self._others = others

    def __call__(self, frame: np.ndarray, mph: float, command: Command) -> float:
        """Return the spread of a frame."""
        others = [one(frame, mph).steering for one in self._others]
        return float(np.std([command.steering, *others], ddof=1))


def command_spread(policy: Policy) -> Source:
    """Return the source of the spread that a policy itself returns.

    Raises:
        InputError: the policy returns none.
    """
    if policy(np.zeros((*FRAME, 3), np.uint8), 0.0).spread is None:
        raise InputError("the policy returns none; drivezoo doubt writes one that does")
    return lambda frame, mph, command: float(command.spread or 0.0)
