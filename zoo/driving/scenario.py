"""What a drive depends on besides its policy, with the keys that users type."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal

from pydantic import Field

from zoo.base.command_keys import Untyped
from zoo.base.errors import UsageError
from zoo.driving.interventions import LEAST_MARGIN_M
from zoo.simulator.weather import CLEAR, Weather, read_weather
from zoo.simulator.world_settings import WorldSettings

Laps = Annotated[float, Field(gt=0, le=1000)]
SpeedMph = Annotated[float, Field(ge=1, le=30)]
Throttle = Literal["hold", "network"]
Margin = Annotated[float, Field(ge=LEAST_MARGIN_M, allow_inf_nan=False)]
LAPPED = "embedded", "donkey"  # worlds whose drives end after laps
# Keys that change the embedded simulator alone.
SIMULATED = "direction", "weather", "delay_s", "quality", "offset", "heading", "start"


@dataclass(frozen=True)
class Scenario(WorldSettings):
    """A drive, but for its policy: equal scenarios give equal figures.

    Options of a command that drives are a subclass with further keys, and `one_drive` returns the
    scenario of one of its drives.

    Args:
        track: name or YAML file of a track; several are separated by commas.
        seed: random seed of start and weather; 0 starts at the track's first point.
        laps: laps of each drive; an open road ends every drive at its end.
        speed: speed to hold, mph.
        margin: distance off the centreline that counts as an intervention, m; null: leaving the
            lane.
        throttle: hold: keep the speed; network: use the network's throttle (model=nvidia_speed).
        weather: clear, random (drawn from the seed), or settings such as {fog: 0.4, wet: 1}.
        offset: metres to the right of the seed's start.
        heading: degrees to the right of the seed's heading.
        start: metres along the road at which the drive starts; null: drawn from the seed.
        world: embedded, replay (of the recording that track= names), gymnasium:ID (a Gymnasium
            environment), FILE.yaml (which maps one), donkey (a Donkeycar simulator; track= is
            HOST:PORT/SCENE), or a world of an installed package.
        road: content of the YAML file of a track, in place of `track`.
        loop: see `zoo.simulator.simulated_world.World`, in place of `frame_rate`.
    """

    track: str = "lake"
    seed: Annotated[int, Field(ge=0)] = 0
    laps: Laps = 1.0
    speed: SpeedMph = 15.0
    margin: Margin | None = None
    throttle: Throttle = "hold"
    weather: Weather | str = field(default=CLEAR, kw_only=True)  # type: ignore[assignment] # wider
    offset: float = 0.0
    heading: float = 0.0
    start: float | None = None
    world: str = "embedded"
    road: Annotated[Mapping[str, Any] | None, Untyped()] = field(default=None, hash=False)
    loop: Annotated[Sequence[tuple[float, float]] | None, Untyped()] = None

    def __post_init__(self) -> None:
        """Write `gymnasium:ID` and `FILE.yaml` as the world gymnasium, and its track.

        Raises:
            UsageError: a track is named, too.
        """
        super().__post_init__()
        kind, colon, name = str(self.world).partition(":")
        if str(self.world).endswith((".yaml", ".yml")):
            kind, colon, name = "gymnasium", ":", self.world
        if kind == "gymnasium" and colon:
            if self.track not in ("", Scenario.track):
                raise UsageError(
                    f"track={self.track}: world={self.world} drives no track; drop one"
                )
            object.__setattr__(self, "world", kind)
            object.__setattr__(self, "track", name)

    def one_drive(self, **changes: Any) -> "Scenario":
        """Return the scenario without the further keys of a subclass, with some values changed."""
        values = {key.name: getattr(self, key.name) for key in fields(Scenario)}
        return Scenario(**values | {"weather": read_weather(self.weather)} | changes)

    def check_ignored(self, keys: Sequence[str]) -> None:
        """Raise UsageError if a key that its world ignores is changed: figures would mislead."""
        for key in keys:
            if getattr(self, key) != getattr(Scenario(), key):
                raise UsageError(f"{key}: changes nothing in world={self.world}; drop one")

    @property
    def start_mph(self) -> float:
        """Return the speed at the start: 0 for a network that controls the throttle."""
        return 0.0 if self.throttle == "network" else self.speed
