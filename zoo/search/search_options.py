"""Options of `drivezoo search` and their checks."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from simulator.road_family import RANGES, find_family
from simulator.weather import Weather, read_weather
from simulator.world_settings import WorldSettings
from zoo.base.errors import InputError, UsageError
from zoo.cli.nearest import hint
from zoo.evaluate.evaluate_options import Count, Workers
from zoo.search.failure_archive import Grid
from zoo.search.search_space import SearchSpace
from zoo.worlds.scenario import SpeedMph

VARY = "vary"


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Options of a search; `conf/search.yaml` has their meanings and defaults."""

    family: str
    budget: Count
    sampler: Literal["archive", "tpe", "random", "family"]
    x: str
    y: str
    cells: Annotated[int, Field(ge=2, le=100)]
    weather: str
    length: Annotated[float, Field(ge=RANGES["length"][0], le=RANGES["length"][1])]
    speed: SpeedMph
    frame_rate: float
    delay_s: float
    quality: str
    seed: Annotated[int, Field(ge=0)]
    out: str | None
    table: str | None
    columns: str | None
    workers: Workers

    def space(self) -> SearchSpace:
        """Return the roads and days to search.

        Raises:
            UsageError: there is no such family, or a setting of the world is wrong.
        """
        try:
            settings = WorldSettings(
                frame_rate=self.frame_rate, delay_s=self.delay_s, quality=self.quality
            )
            settings.check()
            return SearchSpace(find_family(self.family), self.length, self._day())
        except InputError as error:
            raise UsageError(str(error)) from None

    def grid(self, space: SearchSpace) -> Grid:
        """Return the cells of the map.

        Raises:
            UsageError: there is no such feature, or both are the same.
        """
        for key, name in (("x", self.x), ("y", self.y)):
            if name not in space.features:
                raise UsageError(f"{key}={name}: no such feature; {hint(name, space.features)}")
        if self.x == self.y:
            raise UsageError(f"y={self.y}: is the same feature as x; name another")
        return Grid(self.x, self.y, space.features, self.cells)

    def _day(self) -> Weather | None:
        if self.weather == VARY:
            return None
        weather = read_weather(self.weather)
        if not isinstance(weather, Weather):
            raise UsageError(f"weather={self.weather}: is drawn for each drive with weather=vary")
        return weather
