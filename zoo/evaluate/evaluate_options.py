"""The options of `python -m zoo.evaluate`, and what is wrong with them."""

from dataclasses import dataclass

from datamodules.errors import InputError, UsageError
from simulator.errors import SimulatorError
from zoo.drives.interventions import LEAST_MARGIN_M

THROTTLES = ("hold", "network")


@dataclass(frozen=True)
class EvaluateOptions:
    """Drives a checkpoint in the embedded world and prints how well it drove. With replay=FOLDER it
    is scored on a recording instead, see python -m zoo.replay.

    Args:
        track: names or files, with commas between.
        laps: driven in each drive.
        seeds: start seeds, one drive each on each track; start seed 0 begins at the first point.
        speed: miles per hour to hold, by the course's PI controller.
        throttle: hold that speed, or network: its own, from a standstill (model=nvidia_speed).
        margin: metres off the centreline that count as an intervention; null for the edge line.
        weather: clear, random for a day drawn from each seed, or {fog: 0.4, wet: 1}.
        direction: 1, or -1 for the other way round.
        frame_rate: frames per second of simulated time.
        delay_s: from a command to the wheels.
        quality: full, or simple pictures.
        film: leaves film.mp4 in each drive's folder.
        film_speed: times as fast as driven that it plays; 3 leaves two frames of three out.
        perturb: names with commas between, or all: sweeps each on the first track.
        out: the folder for figures and pictures; null names one by date and time.
        workers: processes; 0 takes one a core.
    """

    track: str = "lake"
    laps: float = 1.0
    seeds: int = 1
    speed: float = 15.0
    throttle: str = "hold"
    margin: float | None = None
    weather: str = "clear"
    direction: int = 1
    frame_rate: float = 15.0
    delay_s: float = 0.0
    quality: str = "full"
    film: bool = False
    film_speed: float = 1.0
    perturb: str | None = None
    out: str | None = None
    workers: int = 0

    @property
    def tracks(self) -> list[str]:
        return list(dict.fromkeys(name for name in self.track.split(",") if name))


def check_options(options: EvaluateOptions) -> None:
    """What a process would find out late; opening a world without pictures checks the rest.

    Raises:
        InputError: an option that cannot be.
    """
    from simulator.pictures import QUALITIES
    from simulator.weather import read_weather
    from simulator.world import open_world

    if options.seeds < 1 or options.workers < 0 or not 0 < options.laps <= 1000:
        raise InputError("laps and seeds must be above 0, workers 0 or more")
    if options.quality not in QUALITIES:
        raise InputError(f"quality={options.quality}: must be {' or '.join(QUALITIES)}")
    if not 1 <= options.speed <= 30:
        raise InputError(f"speed={options.speed:g}: must be in 1..30 mph")
    if options.throttle not in THROTTLES:
        raise InputError(f"throttle={options.throttle}: must be {' or '.join(THROTTLES)}")
    if options.margin is not None and not options.margin >= LEAST_MARGIN_M:
        raise InputError(
            f"margin={options.margin:g}: must be {LEAST_MARGIN_M} metres or more, or null"
        )
    if not 1 <= options.film_speed <= 100:
        raise InputError(f"film_speed={options.film_speed:g}: must be in 1..100")
    if not options.tracks:
        raise InputError("track: names none; try track=lake,mountain")
    try:
        read_weather(options.weather)
        for name in options.tracks:
            open_world(
                name,
                "none",
                frame_rate=options.frame_rate,
                delay_s=options.delay_s,
                direction=options.direction,
            )
    except SimulatorError as error:
        raise InputError(str(error)) from None


def options_from(arguments: list[str]) -> EvaluateOptions:
    """Of `key=value` arguments.

    Raises:
        UsageError: no such key, with the nearest; a value of another type.
    """
    from simulator.command_line import read_options

    try:
        return read_options(EvaluateOptions, arguments)
    except SimulatorError as error:
        raise UsageError(str(error)) from None
