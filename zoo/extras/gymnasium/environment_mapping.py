"""What an environment's observation, action and attributes mean to a car, as YAML files say.

`conf/environment` of this folder has those of known environments. A file says where numbers stand
and what they are multiplied by. A user's own file, which another person may have written, names no
module and no argument of an environment: both can choose code that runs.
"""

from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from zoo.base.conf_files import choice_files
from zoo.base.errors import InputError, placed_errors
from zoo.base.plain_files import read_yaml
from zoo.simulator.yaml_fields import Keys, Number, Whole, number, read_keys

# No name may begin with an underscore: those lead out of an environment.
Place = Annotated[
    str, Field(pattern=r"^(observation|info|env|render|terminated|truncated)(\.-?[^\W_]\w*)*$")
]


class Quantity(Keys):
    """A number that an environment gives.

    Attributes:
        place: where it stands, see `Environment`.
        factor: factor to mph, or to metres.
    """

    place: Place
    factor: Number = 1.0


class Control(Keys):
    """A component of the action.

    Attributes:
        component: its number, from 0.
        full: its value at full steering to the right, full throttle or full brake; 0 is 0.
    """

    component: Whole = 0
    full: Number = 1.0


class OwnEnvironment(Keys):
    """Keys of a user's file that maps an environment.

    A place is `observation`, `info`, `env` (the environment itself), `render` (the image that it
    renders), `terminated` or `truncated`, and then the names of keys and attributes or numbers of
    elements, each after a dot: `env.vehicle.lane_offset.1`.

    Attributes:
        env: id of the environment; in `conf/environment` a pattern such as `CarRacing-v*`.
        image: place of the image, uint8 [H, W, 3] RGB.
        speed: speed of the car, with the factor to mph; None if it is unknown.
        steering: component of the action.
        throttle: component of the action; None if the car drives at a speed of its own.
        brake: component of the action; None brakes by a negative throttle, as far as there is one.
        cross_track: metres right of the lane's middle; None leaves the autonomy unmeasured.
        width: width of the lane in metres; None for `margin`.
        distance: metres along the lap.
        lap: whole laps since the reset.
        interventions: places of values that are an intervention unless false, 0 or `none`.
        frame_rate: steps per second of simulated time; None for the scenario's.
        seconds: longest drive in seconds of simulated time.
    """

    env: str
    image: Place = "observation"
    speed: Quantity | None = None
    steering: Control = Control()
    throttle: Control | None = None
    brake: Control | None = None
    cross_track: Quantity | None = None
    width: Quantity | None = None
    distance: Quantity | None = None
    lap: Quantity | None = None
    interventions: tuple[Place, ...] = ()
    frame_rate: Annotated[float, number(0.1, 1000)] | None = None
    seconds: Annotated[float, number(1, 100_000)] = 300.0


class Environment(OwnEnvironment):
    """Keys of a file of drivezoo, or of a part.

    Attributes:
        module: module that registers the environment; None if its package does when installed.
        package: what pip installs.
        arguments: arguments of `gymnasium.make`.
    """

    module: str | None = None
    package: str | None = None
    arguments: dict[str, Any] = Field(default_factory=dict)


def find_environment(track: str) -> tuple[Environment, bool]:
    """Return an environment by its id or by the file that maps it, and whether a file does.

    The keys of a user's file replace those of `conf/environment` for the same environment.

    Raises:
        InputError: the file cannot be read, or a key or value is wrong.
    """
    env, typed = track, {}
    if track.endswith((".yaml", ".yml")):
        user_mapping = _read_file(OwnEnvironment, Path(track))
        env = user_mapping.env
        typed = {name: getattr(user_mapping, name) for name in user_mapping.model_fields_set}
    mapping = Environment(env=env)
    for path in choice_files("environment").values():
        if fnmatchcase(env, (shipped := _read_file(Environment, path)).env):
            mapping = shipped.model_copy(update={"env": env})
    return mapping.model_copy(update=typed), bool(typed) or mapping.package is not None


def _read_file(kind: Any, path: Path) -> Any:
    content = read_yaml(path)
    with placed_errors(path):
        return read_keys(kind, content)


def value_at(path: str, sources: Mapping[str, Any]) -> Any:
    """Return the value at a place; see `OwnEnvironment`. Nothing is called.

    Raises:
        InputError: there is no such value.

    >>> value_at("info.hit.0", {"info": {"hit": [True]}})
    True
    """
    first, *names = path.split(".")
    value = sources[first]
    for name in names:
        try:
            if isinstance(value, Mapping):
                value = value[name]
            elif name.lstrip("-").isdigit():
                value = value[int(name)]
            else:
                value = getattr(value, name)
        except (AttributeError, LookupError, TypeError):
            keys = f"; it has {', '.join(map(str, value))}" if isinstance(value, Mapping) else ""
            raise InputError(f"{path}: the environment gives no {name}{keys:.300}") from None
    return value
