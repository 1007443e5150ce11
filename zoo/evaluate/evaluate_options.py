"""Options of `drivezoo evaluate` and their checks."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from simulator.world_settings import WorldSettings
from zoo.base.errors import InputError, UsageError
from zoo.drives.interventions import LEAST_MARGIN_M

Laps = Annotated[float, Field(gt=0, le=1000)]
Count = Annotated[int, Field(ge=1)]
Workers = Annotated[int, Field(ge=0)]
SpeedMph = Annotated[float, Field(ge=1, le=30)]
Throttle = Literal["hold", "network"]
Margin = Annotated[float, Field(ge=LEAST_MARGIN_M, allow_inf_nan=False)]


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(WorldSettings):
    """Options of an evaluation; `conf/evaluate.yaml` has their meanings and defaults."""

    laps: Laps
    seeds: Count
    speed: SpeedMph
    throttle: Throttle
    margin: Margin | None
    film: bool
    film_speed: Annotated[float, Field(ge=1, le=100)]
    perturb: str | None
    replay: str | None
    guard: str | None
    out: str | None
    table: str | None
    columns: str | None
    plot: str | None
    workers: Workers

    @property
    def tracks(self) -> list[str]:
        """Return the tracks' names or files, each once."""
        return track_names(self.track)


def track_names(text: str) -> list[str]:
    """Return the names in `lake,mountain`, each once."""
    return list(dict.fromkeys(name for name in text.split(",") if name))


def check_world(options: WorldSettings) -> None:
    """Raise UsageError if a world of the options cannot be opened; nothing is rendered."""
    from dataclasses import replace

    from simulator.world import open_world

    names = track_names(options.track)
    if not names:
        raise UsageError("track=: no track named; try track=lake,mountain")
    try:
        options.check()
        for name in names:
            open_world(renderer="none", **replace(options, track=name).place)
    except InputError as error:
        raise UsageError(str(error)) from None
