"""The contract of a policy, and the command that it returns."""

import copy
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from datamodules.format_options import ReadOptions, said_in
from datamodules.known_formats import known_format
from datamodules.recording_format import unused_keys
from zoo.base.errors import library_errors
from zoo.base.rig import CURVATURE, Rig, SteeringLabel
from zoo.checkpoints.checkpoint_path import trained_data


@dataclass(frozen=True)
class Command:
    """A policy's output for one frame; it unpacks as the pair of steering and throttle.

    Attributes:
        steering: steering -1..1, negative is left.
        throttle: throttle -1..1, negative brakes; None from a network that predicts none.
        spread: standard deviation of the steering, 0 or more, by which the policy doubts it; None
            from a policy that does not know.
    """

    steering: float
    throttle: float | None = None
    spread: float | None = None

    def __iter__(self) -> Iterator[float | None]:
        return iter((self.steering, self.throttle))

    def __getitem__(self, number: int) -> float | None:
        return (self.steering, self.throttle)[number]


# Function of a frame, uint8 [H, W, 3] RGB (None in a world without a renderer), and mph. A
# plain function may return a pair of steering and throttle; `as_policy` makes a policy of it.
PolicyFunction = Callable[[Any, float], Command | tuple[float, float | None]]


class Policy:
    """What drives a car: a function of a frame and a speed, and facts about it.

    A subclass defines `__call__`. All other methods and attributes have defaults, those of a policy
    without a state and without networks.

    Attributes:
        name: name of its network, for messages and tables.
        parameters: number of parameters of its networks.
        outputs: 1 for steering, 2 for steering and throttle.
        takes_speed: whether the command depends on the speed.
        predicts_spread: whether the command has a spread.
        latency_s: seconds from a command to the wheels, which a driver sets before each call; None
            for a policy that does not predict steps ahead.
        view: what the network sees of a frame; None without a network.
        config, data: the experiment's config, and the recording's `fingerprint` and `rows`; empty
            without a checkpoint.
        engine: facts about what runs the network, see `chosen_forward`; empty without a network.
        rig: driven car, see `in_car`; None if it is unknown.
        tied: why the same frames give other commands on another processor; empty if they do not.
    """

    name: str = "policy"
    parameters: int = 0
    outputs: int = 1
    takes_speed: bool = False
    predicts_spread: bool = False
    latency_s: float | None = None
    view: Any = None
    config: Mapping[str, Any] = MappingProxyType({})
    data: Mapping[str, Any] = MappingProxyType({})
    engine: Mapping[str, Any] = MappingProxyType({})
    rig: Rig | None = None
    tied: str = ""

    def __call__(self, frame: Any, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [H, W, 3].
            speed_mph: the car's speed in mph.
        """
        raise NotImplementedError

    def reset(self) -> None:
        """Forget the frames before, at a start and after the car was put back."""

    def session(self) -> "Policy":
        """Return the policy for one more car: with a state of its own, if it keeps one."""
        return self

    def scored(self) -> "Policy":
        """Return a session for a drive that is scored: equal on all processors, where it can be."""
        return self.session()

    def expect(self, steering: np.ndarray) -> None:
        """Take the steering of the wheels from now until a command reaches them.

        Args:
            steering: float [n], -1..1, evenly spaced over `latency_s`.
        """

    @property
    def members(self) -> tuple["Policy", ...]:
        """Return the policies of an ensemble, or the policy itself."""
        return (self,)

    def in_car(self, rig: Rig | None) -> "Policy":
        """Set the driven car of all members, None if it is unknown, and return the policy."""
        for member in self.members:
            member.rig = rig
        return self

    @property
    def label(self) -> SteeringLabel:
        """Return what the steering of the network's outputs means."""
        return SteeringLabel(self.data.get(CURVATURE))

    def for_car(self, command: Command) -> Command:
        """Return a network's command as that of the driven car.

        Raises:
            UsageError: see `SteeringLabel.steering`.
        """
        if self.label.is_steering:
            return command
        half = (command.spread or 0.0) / 2
        labels = np.array([command.steering, command.steering - half, command.steering + half])
        steering, low, high = self.label.steering(labels, self.rig).tolist()
        return replace(command, steering=steering, spread=command.spread and high - low)


class FunctionPolicy(Policy):
    """A plain function of a frame and mph as a policy.

    >>> def steer_left(frame, speed_mph):
    ...     return -0.1, None
    >>> FunctionPolicy(steer_left).name, FunctionPolicy(steer_left)(None, 9.0).steering
    ('steer_left', -0.1)
    """

    tied = "a function, whose arithmetic is unknown"

    def __init__(self, function: PolicyFunction) -> None:
        self.function = function
        self.name = getattr(function, "__name__", type(function).__name__)

    def __call__(self, frame: Any, speed_mph: float) -> Command:
        """Return the function's command for a frame."""
        output = self.function(frame, speed_mph)
        with library_errors(self.name, f"returned {output!r:.80}", "return steering and throttle"):
            command = output if isinstance(output, Command) else Command(*output)
            math.fsum((command.steering, command.throttle or 0.0))  # raises unless both are numbers
            return command


def as_policy(driver: Policy | PolicyFunction) -> Policy:
    """Return a policy as it is, and a plain function as a policy."""
    return driver if isinstance(driver, Policy) else FunctionPolicy(driver)


def _forwarded(name: str) -> Any:
    """Return a property that reads and sets an attribute of the wrapped policy."""
    return property(
        attrgetter(f"policy.{name}"), lambda self, value: setattr(self.policy, name, value)
    )


class PolicyWrapper(Policy):
    """A policy that has all methods and facts of another one; subclasses change some.

    Args:
        policy: policy to wrap.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    name, parameters, outputs = map(_forwarded, ("name", "parameters", "outputs"))
    takes_speed, predicts_spread = map(_forwarded, ("takes_speed", "predicts_spread"))
    view, config, data, engine = map(_forwarded, ("view", "config", "data", "engine"))
    latency_s, members, tied = map(_forwarded, ("latency_s", "members", "tied"))

    def __call__(self, frame: Any, speed_mph: float) -> Command:
        """Return the wrapped policy's command for a frame."""
        return self.policy(frame, speed_mph)

    def reset(self) -> None:
        """Reset the wrapped policy."""
        self.policy.reset()

    def session(self) -> "Policy":
        """Return a copy that wraps a session of the policy."""
        return self._around(self.policy.session())

    def scored(self) -> "Policy":
        """Return a copy that wraps the policy for a drive that is scored."""
        return self._around(self.policy.scored())

    def _around(self, policy: Policy) -> "Policy":
        other = copy.copy(self)
        other.policy = policy
        return other

    def expect(self, steering: np.ndarray) -> None:
        """Pass on the steering that the wheels will have."""
        self.policy.expect(steering)


def output_command(outputs: Sequence[float], predicts_spread: bool) -> Command:
    """Return the command of a network's row of outputs.

    >>> output_command([1.25, math.log(0.5)], predicts_spread=True)
    Command(steering=1.0, throttle=None, spread=0.5)
    """
    controls = outputs[:-1] if predicts_spread else outputs
    steering, *throttle = (min(max(control, -1.0), 1.0) for control in controls)
    spread = math.exp(min(outputs[-1], 100.0)) if predicts_spread else None
    return Command(steering, throttle[0] if throttle else None, spread)


def read_as_trained(policies: Iterable[Policy], folder: str | Path, read: ReadOptions) -> dict:
    """Return the user's keys, and else what the first training on a recording said of it."""
    path = Path(folder).expanduser().resolve()
    for data in (trained_data(policy.config, policy.data) for policy in policies):
        root = data.get("root")
        roots = root if isinstance(root, list) else [root]
        paths = [Path(str(name)).expanduser().resolve() for name in roots]
        if path in paths:
            said = ReadOptions(**said_in(data)).of_each(len(paths))[paths.index(path)]
            name, _ = known_format(path, said.format) or ("", None)
            others = unused_keys(name, said)  # which another recording of the training uses
            used = {key: value for key, value in said.given().items() if key not in others}
            return used | read.given()
    return read.given()
