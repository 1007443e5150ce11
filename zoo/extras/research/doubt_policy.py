"""Policies that return a spread: an ensemble, and a network under several dropout masks.

Sources: Lakshminarayanan et al. 2017, "Simple and scalable predictive uncertainty"; Gal and
Ghahramani 2016, "Dropout as a Bayesian approximation".
"""

import copy
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from datamodules.recorded_car import car_names
from datamodules.view import View
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.engine import Engine, chosen_forward
from zoo.checkpoints.frozen_graph import NetworkPolicy, network_inputs
from zoo.checkpoints.policy_base import Command, Policy, output_command
from zoo.models.network_facts import facts_of


class EnsemblePolicy(Policy):
    """A policy that asks several policies, and returns their mean and spread.

    Each member has its own view. Where members predict a spread of their own, the variance is the
    mean of theirs plus the variance of their steering.

    Args:
        members: policies of checkpoints.

    Attributes:
        view: the first member's.
        config: the first member's, with `name` as the model's name.
        data: facts on the recordings that are the same for all members; and all their cars.
    """

    predicts_spread = True

    def __init__(self, members: Sequence[Policy]) -> None:
        self._members = tuple(members)
        first = self.members[0]
        self.view = first.view
        facts = [member.data.items() for member in self.members]
        self.data = dict(fact for fact in facts[0] if all(fact in others for others in facts))
        source = car_names(member.data.get("source") for member in self.members)
        self.data |= {"source": source} if source else {}
        counts = Counter(member.name for member in self.members)
        self.name = " and ".join(f"{count} {name}" for name, count in counts.items())
        self.config = {**first.config, "model": first.config.get("model", {}) | {"name": self.name}}
        self.parameters = sum(member.parameters for member in self.members)
        self.takes_speed = any(member.takes_speed for member in self.members)
        self.outputs = min(member.outputs for member in self.members)
        self.tied = next((member.tied for member in self.members if member.tied), "")

    @property
    def members(self) -> tuple[Policy, ...]:
        """Return the policies of the ensemble."""
        return self._members

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the members' mean command for a frame; its spread is theirs."""
        return mixture([member(frame, speed_mph) for member in self.members])

    def reset(self) -> None:
        """Reset the members."""
        for member in self.members:
            member.reset()

    def session(self) -> "EnsemblePolicy":
        """Return an ensemble for one more car."""
        return EnsemblePolicy([member.session() for member in self.members])

    def scored(self) -> "EnsemblePolicy":
        """Return an ensemble of members for a drive that is scored."""
        return EnsemblePolicy([member.scored() for member in self.members])

    @property
    def latency_s(self) -> float | None:
        """Return the seconds from a command to the wheels; None if no member predicts ahead."""
        return next(
            (member.latency_s for member in self.members if member.latency_s is not None), None
        )

    @latency_s.setter
    def latency_s(self, seconds: float | None) -> None:
        for member in self.members:
            if member.latency_s is not None:
                member.latency_s = seconds

    def expect(self, steering: np.ndarray) -> None:
        """Pass on the steering that the wheels will have."""
        for member in self.members:
            member.expect(steering)


LAYERS = (nn.Dropout, nn.Dropout1d, nn.Dropout2d, nn.Dropout3d)


class DropoutPolicy(NetworkPolicy):
    """A policy that runs a network under several dropout masks, and returns mean and spread.

    The masks are drawn once, from the seed, and stay the same for every frame. New masks for each
    frame would make the steering tremble, and take 30 % of the time (PilotNet, 20 samples).

    Args:
        checkpoint: checkpoint of a network with dropout.
        samples: number of masks.
        seed: random seed of the masks.
        engine, threads: see `chosen_forward`.

    Attributes:
        network: network in evaluation mode, without dropout; must not be changed.
        config: the checkpoint's, with `name` as the model's name.

    Raises:
        InputError: the network has no dropout, or remembers frames.
    """

    def __init__(
        self,
        checkpoint: Checkpoint,
        samples: int,
        seed: int,
        engine: Engine = "torch",
        threads: int = 1,
    ) -> None:
        super().__init__(checkpoint)
        self.predicts_spread = True
        self.name = f"{self.name} with {samples} dropout samples"
        model = {**checkpoint.config.get("model", {}), "name": self.name}
        self.config = checkpoint.config | {"model": model}
        self.sampled = SampledNetwork(self.network, self.view, samples, seed)
        sampled = replace(checkpoint, network=self.sampled)
        self.forward, self.engine = chosen_forward(sampled, engine, threads)

    def scored(self) -> "DropoutPolicy":
        """Return the policy that computes in double precision; see `double_forward`."""
        return self.in_double(self.sampled)

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the mean command of the samples for a frame; its spread is theirs.

        Args:
            frame: RGB image of the centre camera, uint8 [H, W, 3].
            speed_mph: the car's speed in mph.
        """
        inputs = network_inputs(self.view(frame), speed_mph if self.takes_speed else None)
        rows = self.forward(*inputs).tolist()
        spread = facts_of(self.network).predicts_spread
        return self.for_car(mixture([output_command(row, spread) for row in rows]))


class SampledNetwork(nn.Module):
    """A network whose dropout layers have several fixed masks, for one image.

    All samples are one batch. The layers before the first dropout run on the one image.

    Args:
        network: network in evaluation mode, which is not changed; weights are shared with it.
        view: the network's view.
        samples: number of masks.
        seed: random seed of the masks.

    Raises:
        InputError: the network has no dropout, or remembers frames.
    """

    def __init__(self, network: nn.Module, view: View, samples: int, seed: int) -> None:
        super().__init__()
        name = type(network).__name__
        if facts_of(network).window:
            raise InputError(
                f"{name} remembers frames, of which dropout samples are not supported; name "
                "several checkpoints for an ensemble"
            )
        self.samples, self.takes_speed = samples, facts_of(network).takes_speed
        weights = {
            id(parameter): parameter for parameter in network.parameters()
        }  # shared, not copied
        self.network = copy.deepcopy(network, weights)
        self.dropouts = _fix_masks(self.network, samples, torch.Generator().manual_seed(seed))
        if not self.dropouts:
            raise InputError(
                f"{name} has no dropout, so its samples would be equal; train with model.dropout "
                "above 0 where the model has it, or name several checkpoints for an ensemble"
            )

        self.eval()  # with its new layers, too: only such a network is frozen
        blank = network_inputs(np.zeros(view.shape, np.uint8), 0.0 if self.takes_speed else None)
        with torch.no_grad():  # the first call draws the masks
            try:
                self.copies = 1
                self(*blank)
            except RuntimeError:  # the speed joins the features before the first dropout
                self.copies = samples
                self(*blank)

    def forward(self, images: Tensor, speed: Tensor | None = None) -> Tensor:
        """Return the outputs of every sample, [samples, outputs], for one image [1, C, H, W]."""
        for dropout in self.dropouts:
            dropout.call = 0
        images = images.expand(self.copies, *images.shape[1:])
        return self.network(images, *(() if speed is None else (speed.expand(self.samples),)))


class FixedDropout(nn.Module):
    """A dropout layer with a fixed mask for each sample and each call in a frame.

    Args:
        layer: dropout layer; those of one, two or three dimensions drop whole channels.
        samples: number of masks.
        generator: random generator of the masks, which are drawn in the first frame.

    Attributes:
        call: number of the next call in a frame, which `SampledNetwork` begins at 0.
    """

    def __init__(self, layer: Any, samples: int, generator: torch.Generator) -> None:
        super().__init__()
        self.rate, self.samples, self.generator = float(layer.p), samples, generator
        self.drops_channels = not isinstance(layer, nn.Dropout)
        self.masks: list[Tensor] = []
        self.call = 0

    def forward(self, values: Tensor) -> Tensor:
        """Return the values under each mask, [samples, ...], from [1, ...] or [samples, ...]."""
        if self.call == len(self.masks):
            shape = values.shape[1:2] if self.drops_channels else values.shape[1:]
            masks = torch.rand(self.samples, *shape, generator=self.generator) >= self.rate
            masks = masks.view(self.samples, *shape, *[1] * (values.ndim - 1 - len(shape)))
            masks = masks.to(values.dtype) / (1 - self.rate) if self.rate < 1 else 0 * masks
            if values.ndim == 4:
                masks = masks.contiguous(memory_format=torch.channels_last)
            self.masks.append(masks)
        self.call += 1
        return values * self.masks[self.call - 1]


def _fix_masks(network: nn.Module, samples: int, generator: torch.Generator) -> list[FixedDropout]:
    """Replace the dropout layers of a network, by each of their names; return the new ones."""
    dropouts = {
        name: FixedDropout(layer, samples, generator)
        for name, layer in network.named_modules(remove_duplicate=False)
        if isinstance(layer, LAYERS) and layer.p > 0
    }
    for name, dropout in dropouts.items():
        parent, _, last = name.rpartition(".")
        setattr(network.get_submodule(parent), last, dropout)
    return [*dropouts.values()]


def mixture(commands: Sequence[Command]) -> Command:
    """Return the mean command, with the standard deviation of the mixture as its spread.

    The variance is that of the steering plus the mean of the commands' own variances
    (Lakshminarayanan et al. 2017). There is a throttle only if all commands have one.

    >>> mixture([Command(0.0), Command(0.5)])
    Command(steering=0.25, throttle=None, spread=0.25)
    """
    count = len(commands)
    steering = sum(command.steering for command in commands) / count
    squares = (
        (command.steering - steering) ** 2 + (command.spread or 0.0) ** 2 for command in commands
    )
    throttles = [command.throttle for command in commands if command.throttle is not None]
    throttle = sum(throttles) / count if len(throttles) == count else None
    return Command(steering, throttle, math.sqrt(sum(squares) / count))
