"""Keys of `drivezoo guard` and their checks."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from simulator.weather import read_weather
from simulator.world_settings import WorldSettings
from zoo.base.errors import UsageError, hint
from zoo.evaluate.evaluate_options import Count, Workers, check_world, track_names
from zoo.monitor import MOST_SAMPLES
from zoo.runs.table_files import TableFiles
from zoo.worlds.scenario import Laps, Margin, Scenario, SpeedMph


@dataclass(frozen=True, kw_only=True)
class GuardOptions(TableFiles, WorldSettings):
    """Keys of the guard.

    Args:
        track: name or YAML file of a track; not given: lake, for a network of its car.
        speed: speed to hold, mph.
        laps: laps of each drive through a condition.
        nominal_laps: laps of each nominal drive; together they should pass every place.
        margin: distance off the centreline that counts as a failure, m; null: leaving the lane.
        nominal: nominal drives that train the scores; as many fit the thresholds, and as many count
            false alarms.
        levels: levels each of fog, rain and light.
        degraded: networks with noise in their weights.
        false_alarms: share of nominal windows that may raise an alarm.
        epochs: epochs of the autoencoders.
        samples: passes of Monte-Carlo dropout for each frame.
        ensemble: further checkpoints, separated by commas, whose steering is compared.
        method: score of the guard file; null: the best F3.
        slow: speed to slow down to while the guard fires, mph.
        paired: true: drive all conditions again, with the guard and at its mean speed.
        out: output folder; null: named by date and time.
        table: file to write the tables of warnings to: .csv, .tex or .parquet; an existing one is
            replaced.
        workers: processes that drive; 0: one per core.
    """

    track: str = ""
    speed: SpeedMph = 15.0
    laps: Laps = 0.25
    nominal_laps: Laps = 1.0
    margin: Margin | None = None
    nominal: Count = 3
    levels: Annotated[int, Field(ge=1, le=100)] = 10
    degraded: Annotated[int, Field(ge=0, le=100)] = 6
    false_alarms: Annotated[float, Field(gt=0, lt=1)] = 0.05
    epochs: Annotated[int, Field(ge=1, le=10_000)] = 20
    samples: Annotated[int, Field(ge=2, le=MOST_SAMPLES)] = 16
    ensemble: str | None = None
    method: str | None = None
    slow: Annotated[float, Field(ge=4, le=30)] = 6.0
    paired: bool = True
    out: str | None = None
    workers: Workers = 0

    def check(self) -> None:
        """Raise UsageError for a value that is not allowed."""
        from zoo.monitor.scores import METHODS  # slow imports
        from zoo.monitor.signals import ENSEMBLE

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
