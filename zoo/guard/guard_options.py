"""Options of `drivezoo guard` and their checks."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from simulator.weather import read_weather
from simulator.world_settings import WorldSettings
from zoo.base.errors import UsageError
from zoo.cli.nearest import hint
from zoo.evaluate.evaluate_options import Count, Workers, check_world, track_names
from zoo.monitor.scores import METHODS
from zoo.monitor.signals import ENSEMBLE, MOST_SAMPLES
from zoo.worlds.scenario import Laps, Margin, Scenario, SpeedMph


@dataclass(frozen=True, kw_only=True)
class GuardOptions(WorldSettings):
    """Options of the guard; `conf/guard.yaml` has their meanings and defaults."""

    speed: SpeedMph
    laps: Laps
    nominal_laps: Laps
    margin: Margin | None
    nominal: Count
    levels: Annotated[int, Field(ge=1, le=100)]
    degraded: Annotated[int, Field(ge=0, le=100)]
    false_alarms: Annotated[float, Field(gt=0, lt=1)]
    epochs: Annotated[int, Field(ge=1, le=10_000)]
    samples: Annotated[int, Field(ge=2, le=MOST_SAMPLES)]
    ensemble: str | None
    method: str | None
    slow: Annotated[float, Field(ge=4, le=30)]
    paired: bool
    out: str | None
    table: str | None
    columns: str | None
    workers: Workers

    def check(self) -> None:
        """Raise UsageError for a value that is not allowed."""
        super().check()
        if len(track_names(self.track)) != 1:
            raise UsageError(f"track={self.track}: name one track")
        if isinstance(read_weather(self.weather), str):
            raise UsageError(f"weather={self.weather}: nominal drives share one weather; try clear")
        usable = [name for name, one in METHODS.items() if one.signal != ENSEMBLE]
        if self.method == ENSEMBLE:
            raise UsageError(
                "method=ensemble: a guard file holds one checkpoint; write an ensemble as one "
                "checkpoint (drivezoo doubt), and use method=spread with it"
            )
        if self.method is not None and self.method not in usable:
            raise UsageError(f"method={self.method}: no such method; {hint(self.method, usable)}")

    def usual(self) -> Scenario:
        """Return a nominal drive with seed 0.

        Raises:
            UsageError: the world cannot be opened, or a value is not allowed.
        """
        check_world(self)
        return Scenario(
            **self.place,
            laps=self.nominal_laps,
            speed=self.speed,
            margin=self.margin,
            weather=read_weather(self.weather),
        )

    @property
    def members(self) -> list[str]:
        """Return the paths of the further checkpoints."""
        return [one for one in (self.ensemble or "").split(",") if one]
