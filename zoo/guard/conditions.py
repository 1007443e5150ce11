"""Conditions of the drives: levels of weather and light, and degraded networks."""

from dataclasses import dataclass, replace

import torch

from simulator.weather import CLEAR, Weather
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.command import Policy
from zoo.checkpoints.policy import CheckpointPolicy, load_policy
from zoo.worlds.run_drives import PolicyMaker
from zoo.worlds.scenario import Scenario
from zoo.worlds.world import World

NOMINAL, WEATHER, DEGRADED = "nominal", "weather", "degraded"  # groups
NOISE = (0.05, 0.8)  # smallest and largest deviation of the weights' noise


@dataclass(frozen=True)
class Condition:
    """A condition of a drive.

    Attributes:
        group: NOMINAL, WEATHER or DEGRADED.
        kind: nominal, fog, rain, light or weights.
        level: strength, 0 to 1.
        scenario: drive, but for its policy.
        noise: standard deviation of the noise of the network's weights, as a multiple of their own.
    """

    group: str
    kind: str
    level: float
    scenario: Scenario
    noise: float = 0.0

    @property
    def name(self) -> str:
        """Return kind and level, such as `fog 0.3`."""
        return f"{self.kind} {self.level:.2g}"


def shifted_conditions(usual: Scenario, levels: int, degraded: int) -> list[Condition]:
    """Return conditions that no nominal drive has; each starts with a seed of its own.

    Args:
        usual: a nominal drive with the first seed to use.
        levels: levels each of fog, rain and light; 10 gives thirty.
        degraded: number of degraded networks, with rising noise of the weights.
    """
    base = usual.weather if isinstance(usual.weather, Weather) else CLEAR
    found = [
        (WEATHER, kind, number / levels, make(base, number / levels), 0.0)
        for kind, make in (("fog", foggy), ("rain", rainy), ("light", dark))
        for number in range(1, levels + 1)
    ]
    for number in range(1, degraded + 1):
        level = number / degraded
        noise = NOISE[0] * (NOISE[1] / NOISE[0]) ** level
        found.append((DEGRADED, "weights", level, base, noise))
    return [
        Condition(group, kind, level, replace(usual, seed=usual.seed + row, weather=weather), noise)
        for row, (group, kind, level, weather, noise) in enumerate(found)
    ]


def foggy(weather: Weather, level: float) -> Weather:
    """Return a weather with fog: at level 1 the visibility is 20 m."""
    return replace(weather, fog=level)


def rainy(weather: Weather, level: float) -> Weather:
    """Return a weather with rain, a wet road, some haze and a sun that weakens."""
    return replace(weather, rain=level, wet=level, fog=0.4 * level, sun=1 - 0.7 * level)


def dark(weather: Weather, level: float) -> Weather:
    """Return a weather towards the night: a low sun, and down to 0.08 of the brightness."""
    elevation = weather.sun_elevation_deg * (1 - level) + 6 * level
    brightness = weather.brightness * 0.08**level
    sun = 1 - 0.7 * level
    return replace(weather, sun_elevation_deg=elevation, sun=sun, brightness=brightness)


@dataclass(frozen=True)
class Noisy(PolicyMaker):
    """What makes a checkpoint's policy, with Gaussian noise on the weights of every layer.

    Args:
        checkpoint: checkpoint file.
        noise: standard deviation of the noise, as a multiple of the layer's own; 0 for none.
    """

    checkpoint: str
    noise: float

    def policy(self, world: World, scenario: Scenario) -> Policy:
        """Return the policy, whose noise is drawn from the scenario's seed.

        Raises:
            InputError: the checkpoint cannot be read, or is an ONNX file and gets noise.
        """
        if not self.noise:
            return load_policy(self.checkpoint)
        loaded = load_checkpoint(self.checkpoint)
        generator = torch.Generator().manual_seed(scenario.seed)
        with torch.no_grad():
            for one in loaded.network.parameters():
                if one.ndim > 1:
                    deviation = float(one.std(correction=0))  # 0, not NaN, for a single weight
                    drawn = torch.randn(one.shape, generator=generator)
                    one += self.noise * deviation * drawn
        return CheckpointPolicy(loaded)
