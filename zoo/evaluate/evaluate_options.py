"""Options of `drivezoo evaluate` and their checks."""

from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import Field

from simulator.world_settings import WorldSettings
from zoo.base.errors import InputError, UsageError
from zoo.worlds.scenario import Scenario

Count = Annotated[int, Field(ge=1)]
Workers = Annotated[int, Field(ge=0)]


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(Scenario):
    """Options of an evaluation; `conf/evaluate.yaml` has their meanings and defaults."""

    seeds: Count
    film: bool
    film_speed: Annotated[float, Field(ge=1, le=100)]
    perturb: str | None
    replay: str | None
    out: str | None
    table: str | None
    columns: str | None
    plot: str | None
    workers: Workers

    @property
    def tracks(self) -> list[str]:
        """Return the tracks' names or files, each once."""
        return track_names(self.track)

    @property
    def played_at(self) -> float:
        """Return the films' playing speed as a multiple of the driven speed; 0 for no film."""
        return self.film_speed if self.film else 0.0

    @property
    def scenarios(self) -> list[Scenario]:
        """Return the scenario of each drive, by track, then seed."""
        return [
            self.one_drive(track=track, seed=self.seed + number)
            for track in self.tracks
            for number in range(self.seeds)
        ]


def track_names(text: str) -> list[str]:
    """Return the names in `lake,mountain`, each once."""
    return list(dict.fromkeys(name for name in text.split(",") if name))


def check_world(options: WorldSettings) -> None:
    """Raise UsageError if a world of the options cannot be opened; nothing is rendered."""
    from zoo.worlds.open_world import open_world

    names = track_names(options.track)
    if not names:
        raise UsageError("track=: no track named; try track=lake,mountain")
    try:
        options.check()
        world = options.world if isinstance(options, Scenario) else Scenario.world
        for name in names:
            scenario = Scenario(**replace(options, track=name).place, world=world)
            open_world(scenario, renderer="none").close()
    except InputError as error:
        raise UsageError(str(error)) from None
