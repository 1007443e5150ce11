"""Signals of a frame, from which its scores are computed."""

import copy
from collections.abc import Callable, Sequence

import cv2
import numpy as np
import torch
from torch import nn

from datamodules.view import FRAME
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY
from zoo.checkpoints.command import Command, Policy, as_policy
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
        return attention_map(policy)
    return dropout_spread(policy, samples) if name == DROPOUT else command_spread(policy)


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
        sources[ENSEMBLE] = ensemble_spread(ensemble)
    return sources, lacking


def small_image(frame: np.ndarray) -> np.ndarray:
    """Return a camera frame, uint8 [H, W, 3], at 40 x 80 pixels."""
    return cv2.resize(frame, IMAGE_SIZE, interpolation=cv2.INTER_AREA)


def attention_map(policy: Policy) -> Source:
    """Return the source of a frame's saliency map, uint8 [16, 64, 1], of the rows that it sees.

    Raises:
        InputError: the network has no saliency map.
    """
    if isinstance(policy, CheckpointPolicy) and policy.memory is not None:
        raise InputError("a network with memory has no map of one frame")
    if not isinstance(policy, CheckpointPolicy | OnnxPolicy):
        raise InputError("several networks have no common map")
    saliency = Saliency(policy)

    def of_frame(frame: np.ndarray, mph: float, command: Command) -> np.ndarray:
        top, bottom = saliency.view.rows_cropped(len(frame))
        seen = saliency(frame, mph)[top : len(frame) - bottom]
        small = cv2.resize(seen, MAP_SIZE, interpolation=cv2.INTER_AREA)
        return (255 * small).round().astype(np.uint8)[..., None]

    return of_frame


def dropout_spread(policy: Policy, samples: int) -> Source:
    """Return the source of the steering's standard deviation under dropout.

    Source: Gal and Ghahramani 2016, "Dropout as a Bayesian approximation", arXiv:1506.02142. The
    same masks are drawn for every frame, so a change of the spread comes from the frame.

    Raises:
        InputError: the network has no dropout.
    """
    if not isinstance(policy, CheckpointPolicy) or policy.memory is not None:
        raise InputError("needs a checkpoint of one network without memory")
    network = copy.deepcopy(policy.network)
    layers = [one for one in network.modules() if isinstance(one, nn.Dropout) and one.p]
    if not layers:
        raise InputError(f"{policy.name} has no dropout")
    for one in layers:
        one.train()

    @torch.inference_mode()
    def of_frame(frame: np.ndarray, mph: float, command: Command) -> float:
        inputs = network_inputs(policy.view(frame), mph if policy.takes_speed else None)
        repeated = [one.repeat(samples, *[1] * (one.ndim - 1)) for one in inputs]
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(SEED)
            return float(network(*repeated)[:, 0].clamp(-1, 1).std())

    return of_frame


def ensemble_spread(others: Sequence[Policy]) -> Source:
    """Return the source of the steering's standard deviation over several policies.

    Source: Lakshminarayanan et al. 2017, "Simple and scalable predictive uncertainty estimation
    using deep ensembles", arXiv:1612.01474.
    """

    def of_frame(frame: np.ndarray, mph: float, command: Command) -> float:
        steering = [command.steering, *(one(frame, mph).steering for one in others)]
        return float(np.std(steering, ddof=1))

    return of_frame


def command_spread(policy: Policy) -> Source:
    """Return the source of the spread that a policy itself returns.

    Raises:
        InputError: the policy returns none.
    """
    # In any car: only whether there is a spread is asked for.
    if as_policy(policy).in_car(UDACITY)(np.zeros((*FRAME, 3), np.uint8), 0.0).spread is None:
        raise InputError("the policy returns none; drivezoo doubt writes one that does")
    return lambda frame, mph, command: float(command.spread or 0.0)
