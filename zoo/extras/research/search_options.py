"""Keys of `drivezoo search` and their checks."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from zoo.base.errors import InputError, UsageError, hint
from zoo.driving.scenario import SpeedMph
from zoo.runs.table_files import TableFiles
from zoo.scoring.evaluate_options import Count, Workers
from zoo.simulator.weather import Weather, read_weather
from zoo.simulator.world_settings import Quality, WorldSettings

if TYPE_CHECKING:
    from zoo.extras.research.failure_map import Archive
    from zoo.extras.research.search_space import SearchSpace

VARY = "vary"


@dataclass(frozen=True, kw_only=True)
class SearchOptions(TableFiles):
    """Keys of a search.

    Args:
        family: family of roads whose ranges are searched: name, or YAML file.
        budget: number of drives.
        sampler: archive: random, the family's or changed roads, in cells without a failure; tpe:
            Optuna's TPE; nsga2: roads evolve towards failure and novelty; random: uniform over the
            ranges; family: the family's own.
        x: feature along the map: bend, width, grade; with weather=vary also sun, brightness, fog,
            rain, wet, noise.
        y: feature up the map.
        cells: cells of the map along each feature.
        weather: vary: search days, too; clear, or settings such as {fog: 0.4}: one day.
        length: metres of each road.
        speed: speed to hold, mph.
        frame_rate: frames per second of simulated time.
        delay_s: seconds from a command to the wheels.
        quality: full, or fast (about twice as fast, less detail far away), or simple.
        seed: random seed of the search.
        out: output folder; null: named by date and time.
        workers: processes that drive, 8 at most; 0: one per core.
    """

    family: str = "alpine"
    budget: Count = 200
    sampler: Literal["archive", "tpe", "nsga2", "random", "family"] = "archive"
    x: str = "bend"
    y: str = "width"
    cells: Annotated[int, Field(ge=2, le=100)] = 10
    weather: str = VARY
    length: Annotated[float, Field(ge=60, le=20_000)] = 150.0  # as a RoadFamily
    speed: SpeedMph = 15.0
    frame_rate: float = 15.0
    delay_s: float = 0.0
    quality: Quality = "full"
    seed: Annotated[int, Field(ge=0)] = 0
    out: str | None = None
    workers: Workers = 0

    def space(self) -> "SearchSpace":
        """Return the roads and days to search.

        Raises:
            UsageError: there is no such family, or a setting of the world is wrong.
        """
        from zoo.extras.research.search_space import SearchSpace
        from zoo.simulator.road_family import find_family  # slow imports

        try:
            settings = WorldSettings(
                frame_rate=self.frame_rate, delay_s=self.delay_s, quality=self.quality
            )
            settings.check()
            return SearchSpace(find_family(self.family), self.length, self._day())
        except InputError as error:
            raise UsageError(str(error)) from None

    def archive(self, space: "SearchSpace") -> "Archive":
        """Return the cells of the map, without a drive.

        Raises:
            UsageError: there is no such feature, it is one number, or both are the same.
        """
        from zoo.extras.research.failure_map import Archive  # slow import

        for key, name in (("x", self.x), ("y", self.y)):
            if name not in space.features:
                raise UsageError(f"{key}={name}: no such feature; {hint(name, space.features)}")
            if (scale := space.features[name].scale).low == scale.high:
                what = f"is {scale.low:g} on each road of {self.family}; name another feature"
                raise UsageError(f"{key}={name}: {what}")
        if self.x == self.y:
            raise UsageError(f"y={self.y}: is the same feature as x; name another")
        return Archive(self.x, self.y, space.features, self.cells)

    def _day(self) -> Weather | None:
        if self.weather == VARY:
            return None
        weather = read_weather(self.weather)
        if not isinstance(weather, Weather):
            raise UsageError(f"weather={self.weather}: is drawn for each drive with weather=vary")
        return weather
