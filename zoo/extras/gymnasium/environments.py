"""A Gymnasium environment as a world."""

import importlib
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from zoo.base.errors import InputError, UsageError, hint
from zoo.base.limits import parse_number
from zoo.base.parts import import_part, registering_parts
from zoo.driving.open_world import world
from zoo.driving.scenario import SIMULATED, Scenario
from zoo.driving.world import State, World
from zoo.extras.gymnasium.environment_mapping import (
    Control,
    Environment,
    Quantity,
    find_environment,
    value_at,
)
from zoo.simulator.env import DrivingEnv

if TYPE_CHECKING:
    import gymnasium  # slow import


class EnvironmentWorld(World):
    """A world of an environment whose action is a vector with the steering.

    After an intervention the environment is reset: another episode of the same drive begins.

    Args:
        environment: environment to drive in.
        mapping: meaning of its observation and action; None for that of the simulator's own
            environments: an image, or a dict with `image` and `speed` in mph; steering and
            throttle, -1..1 each; and what `info` has of `cte`, `width`, `distance`, `lap`, `hit`.
        frame_rate: steps per second of simulated time, if neither mapping nor simulator has one.
    """

    tied = "another program's world"
    ignores: tuple[str, ...] = (*SIMULATED, "laps")

    def __init__(
        self,
        environment: "gymnasium.Env",
        mapping: Environment | None = None,
        frame_rate: float = 15.0,
    ) -> None:
        self.environment, self.mapping = environment, mapping
        own = environment.unwrapped if isinstance(environment.unwrapped, DrivingEnv) else None
        self.rig = own.rig if own else None
        own_rate = own.metadata["render_fps"] if own else mapping and mapping.frame_rate
        self.frame_rate = own_rate or frame_rate
        self.ignores += ("frame_rate",) * bool(own_rate)
        self.ignores += ("speed", "throttle") * bool(mapping and mapping.throttle is None)
        self.ignores += ("margin",) * bool(mapping and mapping.cross_track is None)

    def reset(self, scenario: Scenario) -> State:
        """Begin an episode with the scenario's seed.

        Raises:
            InputError: the environment fails, or is not what its mapping says.
        """
        self.track = scenario.track
        self.shape: tuple[int, ...] | None = None
        self.steps, self.episodes, self.rewards = 0, 0, 0.0
        self.laps = self.earlier_laps = 0  # of the drive, and of its earlier episodes
        self.sources: dict[str, Any] = {"env": self.environment.unwrapped}
        state = self._begin(seed=scenario.seed)
        self._check_action()
        if math.isnan(state.speed_mph) and state.throttle is None and scenario.throttle == "hold":
            raise self._fault("gives no speed to hold; name one with speed:, or throttle=network")
        return state

    def frame(self, camera: str = "center") -> np.ndarray:
        """Return the image, uint8 [H, W, 3] RGB."""
        source = self.known.image if camera == "center" else f"observation.{camera}"
        image: np.ndarray
        image = self._call(self.environment.render) if source == "render" else self._value(source)
        shape, kind = np.shape(image), getattr(image, "dtype", type(image).__name__)
        if kind != np.uint8 or len(shape) != 3 or shape[2] != 3:
            raise self._fault(
                f"{source} is {kind} {list(shape)}, but an image is uint8 [H, W, 3]; name another "
                "place with image:, such as render"
            )
        if self.shape not in (None, shape):
            raise self._fault(f"its image changed from {self.shape} to {shape}")
        self.shape = shape
        return image

    def step(self, steering: float, throttle: float) -> State:
        """Take a step; the drive is done when the episode is, but for an intervention."""
        mapping, space = self.known, cast("gymnasium.spaces.Box", self.environment.action_space)
        action = np.zeros(space.shape, np.float32)
        brake = max(-throttle, 0.0)
        values = (steering, throttle if mapping.brake is None else throttle + brake, brake)
        for control, value in zip(_controls(mapping).values(), values, strict=True):
            if control is not None:
                action[control.component] = control.full * value
        self.steps += 1
        action = np.clip(action, space.low, space.high).astype(space.dtype)
        observation, reward, terminated, truncated, info = self._call(self.environment.step, action)
        self.rewards += float(reward)
        return self._state(observation, info, bool(terminated), bool(truncated))

    def put_back(self, speed_mph: float) -> State:
        """Begin another episode, at the same time of the drive."""
        self.earlier_laps = self.laps
        return self._begin()

    def close(self) -> None:
        """Close the environment."""
        self.environment.close()

    def facts(self, scenario: Scenario) -> dict[str, Any]:
        """Return the environment's name as the track, and the seed."""
        return super().facts(scenario) | {"source": "gymnasium", "track": scenario.track}

    def _begin(self, **seed: int) -> State:
        observation, info = self._call(self.environment.reset, **seed)
        if self.episodes == 0:
            self.known = self.mapping or _convention(self.environment, observation, info)
        self.episodes += 1
        return self._state(observation, info)

    def _state(
        self,
        observation: Any,
        info: dict[str, Any],
        terminated: bool = False,
        truncated: bool = False,
    ) -> State:
        self.sources |= {"observation": observation, "info": info}
        self.sources |= {"terminated": terminated, "truncated": truncated}
        mapping, speed_mph = self.known, self._number(self.known.speed)
        time_s = self.steps / self.frame_rate
        is_stopped = any(self._is_stopped(source) for source in mapping.interventions)
        # An episode of ours ends off the road, where a `margin=` may be wider.
        is_stopped = is_stopped or (terminated and bool(info.get("off_road")))
        lap = self._number(mapping.lap)
        if lap is not None:
            self.laps = self.earlier_laps + int(lap)
        return State(
            time_s=time_s,
            speed_mph=math.nan if speed_mph is None else speed_mph,
            throttle=0.0 if mapping.throttle is None else None,
            cross_track_m=self._number(mapping.cross_track),
            width_m=self._number(mapping.width),
            distance_m=self._number(mapping.distance),
            lap=None if lap is None else self.laps,
            contact=is_stopped if mapping.interventions else None,
            share=min(time_s / mapping.seconds, 1.0),
            episode_return=self.rewards / self.episodes,
            done=time_s >= mapping.seconds or ((terminated or truncated) and not is_stopped),
        )

    def _value(self, source: str) -> Any:
        try:
            return value_at(source, self.sources)
        except InputError as error:
            raise self._fault(str(error)) from None

    def _is_stopped(self, source: str) -> bool:
        """Return whether a place of `interventions` says that the car has left the road."""
        value = self._value(source)
        try:
            return bool(value) and value != "none"
        except ValueError:  # an array of several
            what = f"interventions: {source} has {np.size(value):,} values"
            raise self._fault(f"{what}; name one of them, such as {source}.0") from None

    def _number(self, quantity: Quantity | None) -> float | None:
        """Return a quantity in mph or metres; None if the environment has none that is ordinary."""
        if quantity is None:
            return None
        value = self._value(quantity.place)
        try:
            return parse_number(quantity.factor * float(np.asarray(value).item()))
        except (TypeError, ValueError):
            raise self._fault(f"{quantity.place} is {type(value).__name__}, not a number") from None

    def _check_action(self) -> None:
        """Check that each component of the action exists, and takes its full value."""
        space = self.environment.action_space
        low, high = (getattr(space, name, np.zeros(0)) for name in ("low", "high"))
        if np.ndim(low) != 1 or not len(low):
            raise self._fault(f"its action is {space}; a car needs a vector: Box(-1, 1, (2,))")
        for name, control in _controls(self.known).items():
            if control is None:
                continue
            if control.component >= len(low):
                raise self._fault(f"{name}: component: {control.component}; it has {len(low)}")
            ends = (control.full, -control.full) if name == "steering" else (control.full,)
            least, most = low[control.component], high[control.component]
            if not all(least <= end <= most for end in ends):
                raise self._fault(
                    f"{name}: full: {control.full:g}; the action's component {control.component} "
                    f"is {least:g}..{most:g}"
                )

    def _call(self, method: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
        """Return what the environment's method returns; what it raises becomes a line."""
        try:
            return method(*arguments, **keywords)
        except InputError:
            raise
        except Exception as error:  # anything: an environment is another person's program
            reason = " ".join(str(error).split())
            what = f"its {method.__name__} raised {type(error).__name__}: {reason:.300}"
            raise self._fault(what) from error

    def _fault(self, reason: str) -> InputError:
        return InputError(f"track={self.track}: {reason}")


def _controls(mapping: Environment) -> dict[str, Control | None]:
    return {"steering": mapping.steering, "throttle": mapping.throttle, "brake": mapping.brake}


def _convention(
    environment: "gymnasium.Env", observation: Any, info: dict[str, Any]
) -> Environment:
    """Return the mapping of the simulator's own environments, as far as one has its parts."""
    parts = observation if isinstance(observation, dict) else {}
    names = {"cross_track": "cte", "width": "width", "distance": "distance", "lap": "lap"}
    places = {name: f"info.{key}" for name, key in names.items() if key in info}
    if "speed" in parts or "speed_mph" in info:
        places["speed"] = "observation.speed" if "speed" in parts else "info.speed_mph"
    quantities: dict[str, Any] = {key: Quantity(place=value) for key, value in places.items()}
    return Environment(
        env="",
        image="observation.image" if parts else "observation",
        throttle=Control(component=1) if environment.action_space.shape != (1,) else None,
        interventions=("info.hit",) if "hit" in info else (),
        **quantities,
    )


@world("gymnasium")
def open_environment(scenario: Scenario, renderer: str) -> EnvironmentWorld:
    """Return the world of the environment that a scenario's `track` names, or a file that maps it.

    An environment renders by itself.

    Raises:
        InputError: there is no such environment, its package is not installed, or the name would
            import a module.
    """
    import gymnasium

    mapping, is_mapped = find_environment(scenario.track)
    name, where = mapping.env, f"track={scenario.track}"
    if ":" in name:  # a scenario can come from a file that somebody else wrote
        module, _, rest = name.partition(":")
        raise InputError(
            f"{where}: names a module to import; name it yourself with parts={module}, and the "
            f"environment without it, world=gymnasium:{rest}"
        )
    arguments = dict(mapping.arguments)
    if mapping.image == "render":
        arguments["render_mode"] = "rgb_array"
    install = f'; pip install "{mapping.package}"' if mapping.package else ""
    try:
        if name not in gymnasium.registry:
            for part in registering_parts("drivezoo.worlds")[0]:
                import_part(part, part.module)
            if mapping.module is not None:
                importlib.import_module(mapping.module)
        made = gymnasium.make(name, disable_env_checker=True, **arguments)
    except gymnasium.error.UnregisteredEnv:
        near = hint(name, gymnasium.registry, "name the module that registers it with parts=")
        raise UsageError(f"{where}: no such environment; {near}") from None
    except InputError:
        raise
    except Exception as error:
        is_named = isinstance(error, gymnasium.error.Error | ImportError)
        kind = "" if is_named else f"{type(error).__name__}: "
        reason = " ".join(str(error).split())
        raise InputError(f"{where}: {kind}{reason:.300}{install}") from error
    return EnvironmentWorld(made, mapping if is_mapped else None, scenario.frame_rate)
