"""The options of `python -m zoo.correct`, and what is wrong with them."""

from dataclasses import dataclass

from datamodules.errors import InputError, UsageError
from simulator.errors import SimulatorError
from zoo.evaluate import evaluate_options as scoring

FIRST_SEED = 1000  # of the drives that corrections come from; scored are seeds 0, 1, ...


@dataclass(frozen=True)
class CorrectOptions:
    """Corrects a checkpoint where it drives badly (DAgger: Ross, Gordon and Bagnell 2011,
    arXiv:1011.0686). Each round drives it, asks the expert how to steer in what it saw, and trains
    on with the answers. The same command with the same out= goes on where it was stopped. Further
    options with a dot in them, such as data.root=FOLDER or optim.lr=0.0003, change the checkpoint's
    own config.

    Args:
        track: names or files, with commas between: where it is corrected and scored.
        rounds: of driving, asking and training.
        drives: on each track and in each round, to take corrections from.
        laps: driven in each drive.
        seeds: scored drives on each track before and after each round, none of which corrections
            come from.
        speed: miles per hour to hold.
        throttle: hold that speed, or network: its own (model=nvidia_speed).
        margin: metres off the centreline that count as an intervention; null for the edge line.
        direction: 1, or -1 for the other way round.
        weather: of the drives to take corrections from: clear, random, or {fog: 0.4, wet: 1}.
        before_s: seconds before an intervention, in which the expert is asked.
        after_s: seconds after it.
        off_m: the expert is asked wherever it is farther off the centreline, too; 0 asks always,
            as the paper does, null at interventions alone.
        beta: the share of seconds that the expert drives in round 1; its square in round 2, ...
        nudge: steering that pushes it off its line now and then, up to so much.
        expert_speed: miles per hour that the expert's throttle is for, where the network learns it.
        weight: how many times as often as other samples the corrections are drawn.
        epochs: trained in each round.
        enough_m: without interventions and with less mean cross-track error, nothing is corrected.
        drive: instead of asking the expert, the folder of a drive recorded by zoo.drive in which a
            person took over.
        recording: instead of asking the expert, a recording of a person's corrections.
        out: the folder for all of it; null names one by date and time.
        workers: processes that drive; 0 takes one a core.
        trust: classes and keys of the checkpoint's config that are allowed beside the package's
            own, with commas between.
    """

    track: str = "lake"
    rounds: int = 3
    drives: int = 3
    laps: float = 1.0
    seeds: int = 2
    speed: float = 15.0
    throttle: str = "hold"
    margin: float | None = None
    direction: int = 1
    weather: str = "clear"
    before_s: float = 3.0
    after_s: float = 1.0
    off_m: float | None = 1.0
    beta: float = 0.0
    nudge: float = 0.0
    expert_speed: float = 30.0
    weight: float = 4.0
    epochs: int = 3
    enough_m: float = 0.2
    drive: str | None = None
    recording: str | None = None
    out: str | None = None
    workers: int = 0
    trust: str = ""

    @property
    def scored(self) -> scoring.EvaluateOptions:
        """How it is scored before and after each round, in clear weather."""
        return scoring.EvaluateOptions(
            track=self.track,
            laps=self.laps,
            seeds=self.seeds,
            speed=self.speed,
            throttle=self.throttle,
            margin=self.margin,
            direction=self.direction,
            workers=self.workers,
        )

    @property
    def by_a_person(self) -> bool:
        """Whether the corrections are a person's, and so there is one round of them."""
        return self.drive is not None or self.recording is not None


def read_options(arguments: list[str]) -> tuple[CorrectOptions, list[str]]:
    """Of `key=value` arguments; those whose key has a dot are for the checkpoint's config.

    Raises:
        UsageError: no such key, with the nearest; a value of another type, or that cannot be.
    """
    from simulator import command_line

    overrides = [one for one in arguments if "." in one.partition("=")[0]]
    try:
        options = command_line.read_options(
            CorrectOptions, [one for one in arguments if one not in overrides]
        )
    except SimulatorError as error:
        raise UsageError(str(error)) from None
    _check(options)
    return options, overrides


def _check(options: CorrectOptions) -> None:
    from simulator.weather import read_weather

    for key, least, most in (
        ("rounds", 1, 100),
        ("drives", 1, 100),
        ("before_s", 0, 60),
        ("after_s", 0, 60),
        ("beta", 0, 1),
        ("nudge", 0, 1),
        ("expert_speed", 8, 30),
        ("weight", 0.01, 1000),
        ("epochs", 1, 10_000),
        ("enough_m", 0, 100),
    ):
        if not least <= getattr(options, key) <= most:
            raise InputError(f"{key}={getattr(options, key):g}: must be in {least:g}..{most:g}")
    if options.off_m is not None and not options.off_m >= 0:
        raise InputError(f"off_m={options.off_m:g}: must be 0 metres or more, or null")
    if options.before_s + options.after_s == 0 and options.off_m is None:
        raise InputError("before_s=0 after_s=0 off_m=null: the expert would never be asked")
    if options.seeds > FIRST_SEED:
        raise InputError(f"seeds={options.seeds}: must be {FIRST_SEED} or less")
    if options.drive is not None and options.recording is not None:
        raise InputError("drive= and recording= are two ways to the same thing: give one of them")
    try:
        read_weather(options.weather)
    except SimulatorError as error:
        raise InputError(str(error)) from None
    scoring.check_options(options.scored)
