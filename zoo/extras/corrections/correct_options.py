"""Keys of `drivezoo correct` and their checks."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from zoo.base.command_keys import changed
from zoo.base.errors import UsageError
from zoo.driving.scenario import Laps, Margin, Scenario, SpeedMph, Throttle
from zoo.scoring import evaluate_options as scoring
from zoo.simulator.world_settings import WorldSettings

FIRST_SEED = 1000  # first start seed of drives with corrections; scored drives have 0, 1, ...
# Keys that a person's corrections do not use.
OF_EXPERT = ("rounds", "drives", "after_s", "off_m", "beta", "nudge", "expert_speed", "enough_m")

Share = Annotated[float, Field(ge=0, le=1)]
Seconds = Annotated[float, Field(ge=0, le=60)]


@dataclass(frozen=True, kw_only=True)
class CorrectOptions(WorldSettings):
    """Keys of a correction.

    Args:
        track: name or YAML file of a track; several are separated by commas; not given: lake, for a
            network of its car.
        speed: speed to hold, mph.
        rounds: most rounds; each drives, asks the expert and trains.
        drives: drives on each track in each round, from which corrections come.
        laps: laps of each drive.
        seeds: scored drives on each track before and after each round, in clear weather; no
            corrections come from them.
        throttle: hold: keep the speed; network: use the network's throttle (model=nvidia_speed).
        margin: distance off the centreline that counts as an intervention, m; null: leaving the
            lane.
        before_s: seconds before an intervention in which the expert is asked.
        after_s: seconds after an intervention in which the expert is asked.
        off_m: distance off the centreline in m beyond which the expert is also asked; 0: always, as
            in the paper; null: only around interventions.
        beta: share of time that the expert drives in round 1; its square in round 2, and so on.
        nudge: largest random steering that pushes the car off its line.
        expert_speed: speed of the expert's throttle labels, for a network that predicts a throttle,
            mph.
        weight: frequency of corrections relative to other samples.
        epochs: epochs of each round.
        enough_m: mean cross-track error, without interventions, that ends the rounds, m.
        drive: folder of drivezoo drive in which a person took over; replaces the expert's
            corrections.
        recording: recording of a person's corrections; replaces the expert's.
        out: output folder; null: named by date and time.
        workers: processes that drive; 0: one per core.
        trust: further classes and keys that the checkpoint's config may name, separated by commas.
    """

    track: str = ""
    speed: SpeedMph = 15.0
    rounds: Annotated[int, Field(ge=1, le=100)] = 3
    drives: Annotated[int, Field(ge=1, le=100)] = 3
    laps: Laps = 1.0
    seeds: Annotated[int, Field(ge=1, le=FIRST_SEED)] = 2
    throttle: Throttle = "hold"
    margin: Margin | None = None
    before_s: Seconds = 3.0
    after_s: Seconds = 1.0
    off_m: Annotated[float, Field(ge=0)] | None = 1.0
    beta: Share = 0.0
    nudge: Share = 0.0
    expert_speed: Annotated[float, Field(ge=8, le=30)] = 30.0
    weight: Annotated[float, Field(ge=0.01, le=1000)] = 4.0
    epochs: Annotated[int, Field(ge=1, le=10_000)] = 3
    enough_m: Annotated[float, Field(ge=0, le=100)] = 0.2
    drive: str | None = None
    recording: str | None = None
    out: str | None = None
    workers: scoring.Workers = 0
    trust: str = ""

    @property
    def scored(self) -> list[Scenario]:
        """Return the drives before and after each round, by track, then seed, in clear weather."""
        settings = {key: getattr(self, key) for key in ("speed", "laps", "throttle", "margin")}
        return [
            Scenario(**self.place | settings | {"track": track, "seed": seed})
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
    unused = (*OF_EXPERT, "weather", "before_s" if options.recording else "")
    for word in changed(options) if options.by_a_person else []:
        if word.partition("=")[0] in unused:
            raise UsageError(f"{word}: a person's corrections do not use it; leave it out")
