"""Keys of `drivezoo timing`."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from zoo.base.errors import InputError, UsageError
from zoo.driving.scenario import Scenario
from zoo.runs.table_files import ResultFiles
from zoo.scoring.evaluate_options import Workers
from zoo.simulator.weather import read_weather
from zoo.simulator.world_settings import Quality, WorldSettings

WholeMph = Annotated[int, Field(ge=1, le=30)]
LEAST_ROADS = 6  # of fewer, no 95 % interval of a median exists


@dataclass(frozen=True, kw_only=True)
class TimingOptions(ResultFiles):
    """Keys of a search for the highest speed.

    Args:
        family: family of the roads to drive: lakeside, country, alpine, or a YAML file.
        roads: number of roads, whose numbers begin with `seed`; 6 or more.
        length: metres to drive of each road, at most.
        rate: frames per second that the loop is set to, where the times do not say it; Donkeycar's
            DRIVE_LOOP_HZ is 20.
        part: row of Donkeycar's profile that is the pilot; null: found by its name.
        delay_s: seconds that the camera and the servo add, 0..2.
        least: lowest speed to try, whole mph.
        most: highest speed to try, whole mph.
        weather: clear, random (drawn from the seed), or settings such as {fog: 0.4, wet: 1}.
        quality: full, or fast (about twice as fast, less detail far away), or simple.
        seed: number of the first road.
        out: output folder; null: named by date and time.
        workers: processes that drive; 0: one per core.
    """

    family: str = "lakeside"
    roads: Annotated[int, Field(ge=LEAST_ROADS, le=1000)] = 8
    length: Annotated[float, Field(ge=60, le=20_000)] = 200.0
    rate: Annotated[float, Field(ge=1, le=50)] = 20.0
    part: str | None = None
    delay_s: float = 0.0
    least: WholeMph = 5
    most: WholeMph = 30
    weather: str = "clear"
    quality: Quality = "full"
    seed: Annotated[int, Field(ge=0)] = 1
    out: str | None = None
    workers: Workers = 0

    def scenarios(self) -> list[Scenario]:
        """Return the scenario of each road, at any speed.

        Raises:
            UsageError: there is no such family, or a value is not allowed.
        """
        from zoo.simulator.road_family import draw_road, find_family  # slow import: scipy

        if self.most <= self.least:
            raise UsageError(f"most={self.most}: must be above least={self.least}")
        try:
            WorldSettings(delay_s=self.delay_s, quality=self.quality).check()
            family, weather = find_family(self.family), read_weather(self.weather)
            numbers = range(self.seed, self.seed + self.roads)
            lengths = {number: draw_road(family, number).length for number in numbers}
        except InputError as error:
            raise UsageError(str(error)) from None
        return [
            Scenario(
                track=f"{self.family}:{number}",
                laps=min(1.0, self.length / length),
                weather=weather,
                delay_s=self.delay_s,
                quality=self.quality,
            )
            for number, length in lengths.items()
        ]
