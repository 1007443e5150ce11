"""The settings that every command which opens a world has in common."""

from dataclasses import dataclass, fields
from typing import Any

from simulator.errors import SimulatorError
from simulator.rig import PHYSICS_STEP_S
from simulator.weather import read_weather

QUALITIES = ("full", "simple")
LONGEST_DELAY_S = 2.0


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """A world to open; `conf/world/embedded.yaml` has the same keys for the commands of zoo.

    Args:
        track: name, or path of a track's YAML file.
        direction: 1 as the track file gives it, -1 the other way round.
        weather: clear, random for a day drawn from the seed, or {fog: 0.4, wet: 1}.
        frame_rate: frames per second of simulated time, up to 50.
        delay_s: seconds from a command to the wheels, 0..2.
        quality: full, or simple images, which are faster.
    """

    track: str = "lake"
    direction: int = 1
    weather: str = "clear"
    frame_rate: float = 15.0
    delay_s: float = 0.0
    quality: str = "full"

    @property
    def place(self) -> dict[str, Any]:
        """The arguments of `simulator.world.open_world`: all but the weather."""
        names = (field.name for field in fields(WorldSettings))
        return {name: getattr(self, name) for name in names if name != "weather"}

    def check(self) -> None:
        """Raise SimulatorError, in one line, for a value that cannot be."""
        if not 0 < self.frame_rate <= 1 / PHYSICS_STEP_S:
            raise SimulatorError(f"frame_rate={self.frame_rate:g}: must be above 0, up to 50")
        if not 0 <= self.delay_s <= LONGEST_DELAY_S:
            raise SimulatorError(f"delay_s={self.delay_s:g}: must be in 0..2 seconds")
        if self.direction not in (1, -1):
            raise SimulatorError(f"direction={self.direction}: must be 1 or -1")
        if self.quality not in QUALITIES:
            raise SimulatorError(f"quality={self.quality}: must be {' or '.join(QUALITIES)}")
        if isinstance(self.weather, str):
            read_weather(self.weather)
