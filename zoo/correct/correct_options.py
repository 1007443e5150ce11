"""Options of `drivezoo correct` and their checks."""

from dataclasses import dataclass, fields, replace
from typing import Annotated

from pydantic import Field

from simulator.weather import CLEAR
from simulator.world_settings import WorldSettings
from zoo.base.errors import UsageError
from zoo.evaluate import evaluate_options as scoring
from zoo.worlds.scenario import Laps, Margin, Scenario, SpeedMph, Throttle

FIRST_SEED = 1000  # first start seed of drives with corrections; scored drives have 0, 1, ...

Share = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0, le=60)]


@dataclass(frozen=True, kw_only=True)
class CorrectOptions(WorldSettings):
    """Options of a correction; `conf/correct.yaml` has their meanings and defaults."""

    speed: SpeedMph
    rounds: Annotated[int, Field(ge=1, le=100)]
    drives: Annotated[int, Field(ge=1, le=100)]
    laps: Laps
    seeds: Annotated[int, Field(ge=1, le=FIRST_SEED)]
    throttle: Throttle
    margin: Margin | None
    before_s: Seconds
    after_s: Seconds
    off_m: Annotated[float, Field(ge=0)] | None
    beta: Share
    nudge: Share
    expert_speed: Annotated[float, Field(ge=8, le=30)]
    weight: Annotated[float, Field(ge=0.01, le=1000)]
    epochs: Annotated[int, Field(ge=1, le=10_000)]
    enough_m: Annotated[float, Field(ge=0, le=100)]
    drive: str | None
    recording: str | None
    out: str | None
    workers: scoring.Workers
    trust: str

    @property
    def scored(self) -> list[Scenario]:
        """Return the drives before and after each round, by track, then seed, in clear weather."""
        own = {key.name: getattr(self, key.name) for key in fields(WorldSettings)}
        own |= {"speed": self.speed, "laps": self.laps, "weather": CLEAR}
        usual = Scenario(**own, throttle=self.throttle, margin=self.margin)
        return [
            replace(usual, track=track, seed=seed)
            for track in scoring.track_names(self.track)
            for seed in range(self.seeds)
        ]

    @property
    def by_a_person(self) -> bool:
        """Return whether a person corrects, in a single round, instead of the expert."""
        return self.drive is not None or self.recording is not None


def check_correct_options(options: CorrectOptions) -> None:
    """Raise UsageError for options that contradict each other or a world that cannot be opened."""
    if options.before_s + options.after_s == 0 and options.off_m is None:
        raise UsageError(
            "before_s=0 after_s=0 off_m=null: the expert is never asked; set one of them above 0"
        )
    if options.drive is not None and options.recording is not None:
        raise UsageError("drive= and recording= are alternatives; give one of them")
    scoring.check_world(options)
