"""Settings that are the same in every command that opens a world."""

from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from zoo.base.errors import UsageError
from zoo.base.key_values import check_values
from zoo.simulator.track_names import recorded_name
from zoo.simulator.udacity_car import PHYSICS_STEP_S
from zoo.simulator.weather import read_weather

Quality = Literal["full", "fast", "simple"]
DIRECTIONS = {"forward": 1, "1": 1, "backward": -1, "-1": -1}


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """A world to open; `conf/world/embedded.yaml` has the same keys for trainings.

    Args:
        track: name or YAML file of a track.
        direction: forward, or backward (against the order of the track's points).
        weather: clear, random (drawn from the seed), or settings such as {fog: 0.4, wet: 1}.
        frame_rate: frames per second of simulated time.
        delay_s: seconds from a command to the wheels.
        quality: full; fast, with less detail far away; or simple, without shadows.
    """

    directions: ClassVar[tuple[int | str, ...]] = (1, -1)

    track: str = "lake"
    direction: int | str = "forward"
    weather: str = "clear"
    # A lower frame rate drives for hours of simulated time between two frames.
    frame_rate: Annotated[float, Field(ge=0.1, le=1 / PHYSICS_STEP_S)] = 15.0
    delay_s: Annotated[float, Field(ge=0, le=2)] = 0.0
    quality: Quality = "full"

    def __post_init__(self) -> None:
        """Replace the direction's name by 1 or -1, and tracks' names by those in records."""
        if isinstance(self.track, str):  # its type is checked later
            names = ",".join(recorded_name(name) for name in self.track.split(","))
            object.__setattr__(self, "track", names)
        object.__setattr__(self, "direction", DIRECTIONS.get(str(self.direction), self.direction))

    @property
    def place(self) -> dict[str, Any]:
        """Return the arguments of a simulated `open_world`: all settings but the weather."""
        names = (field.name for field in fields(WorldSettings))
        return {name: getattr(self, name) for name in names if name != "weather"}

    def check(self) -> None:
        """Raise UsageError for a value that is not allowed."""
        check_values(self)
        if self.direction not in self.directions:
            allowed = " or ".join(("forward", "backward", *map(str, self.directions[2:])))
            raise UsageError(f"direction={self.direction}: must be {allowed}")
        if isinstance(self.weather, str):
            read_weather(self.weather)
