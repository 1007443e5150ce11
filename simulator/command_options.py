"""Keys of `drivezoo simulator record`, `drive` and `client`."""

from dataclasses import dataclass
from typing import Any

from simulator.legacy_socket import websocket_address
from simulator.world_settings import WorldSettings
from zoo.base.errors import InputError


@dataclass(frozen=True)
class RecordOptions(WorldSettings):
    """Keys of a recording.

    Args:
        out: folder to write; it must not contain a recording.
        laps: number of laps; 0.5 is half a lap. A drive on an open road ends at the road's end, so
            more than 1 counts as 1.
        control: expert (steers exactly), or a simulated student's keyboard (key taps) or mouse.
        speed: speed on straights in mph, 8..30; the driver slows down for sharp bends.
        noise: how far the driver sways off its line, 0..1; only the way back is recorded.
        direction: forward, backward, or both (one after the other).
        seed: random seed of swaying, hand inaccuracy and weather.
        start: start position in metres along the road; null for its begin.
        renderer: auto, software or opengl.
        header: whether the log begins with column names, as the course's sample data does.
        relative: whether the log has paths relative to its folder (IMG/...).
        jobs: number of processes that draw, 1..64; it does not change the files.
    """

    out: str
    laps: float = 1.0
    control: str = "expert"
    speed: float = 30.0
    noise: float = 0.0

    seed: int = 0
    start: float | None = None
    renderer: str = "auto"
    header: bool = False
    relative: bool = False
    jobs: int = 1


@dataclass(frozen=True)
class DriveOptions(WorldSettings):
    """Keys of a drive in a window.

    Args:
        out: folder of the recording; auto is recordings/ and the time of its start.
        seed: random seed of the weather.
        start: start position in metres along the road; null for its begin.
        width: width of the window in pixels, 320..7680; its height is half of that.
        renderer: renderer of the recorded images: auto, software or opengl.
        header: whether the log begins with column names, as the course's sample data does.
        relative: whether the log has paths relative to its folder (IMG/...).
        seconds: seconds of driving until the end; 0 for no end.
    """

    out: str = "auto"

    seed: int = 0
    start: float | None = None
    width: int = 1280
    renderer: str = "auto"
    header: bool = False
    relative: bool = False
    seconds: float = 0.0


@dataclass(frozen=True)
class ClientOptions(WorldSettings):
    """Keys of a client.

    Args:
        url: address of the driver.
        protocol: legacy (the original's Socket.IO of 2016) or modern (python-socketio).
        clock: lockstep (one frame for each reply) or realtime (time passes without replies).
        seed: random seed of the weather.
        start: start position in metres along the road; null for its begin.
        laps: number of laps until the end; 0 for no end but the end of an open road.
        seconds: seconds of simulated time until the end; 0 for no end.
        film: path of the .mp4 to write; null for none.
        window: whether to show the camera's frames in a window.
        manual: spans of seconds in which a simulated person holds W, [[5,7],[20,21]].
        truth: whether telemetry also has the simulated time, the cross-track error, half the
            road's width and wall contact; the original sends none of them.
        put_back: whether the driver may put the car back on the road; needs truth=true. The
            original has no such command.
        decimal_comma: whether numbers have a decimal comma, as in a German locale.
        drop_at: simulated second at which the connection is dropped once; null for never.
        renderer: auto, software or opengl.
    """

    url: str = "http://127.0.0.1:4567"
    protocol: str = "legacy"
    clock: str = "lockstep"
    seed: int = 0
    start: float | None = None
    laps: float = 0.0
    seconds: float = 0.0
    film: str | None = None
    window: bool = False
    manual: tuple[Any, ...] = ()
    truth: bool = False
    put_back: bool = False
    decimal_comma: bool = False
    drop_at: float | None = None
    renderer: str = "auto"


def check_options(options: ClientOptions) -> None:
    """Raise InputError for an option whose value is not allowed."""
    choices = {"protocol": ("legacy", "modern"), "clock": ("lockstep", "realtime")}
    options.check()
    for key, known in choices.items():
        if getattr(options, key) not in known:
            raise InputError(f"{key}={getattr(options, key)}: must be {' or '.join(known)}")
    websocket_address(options.url)
    if options.renderer == "none":
        raise InputError("renderer=none: a driver needs camera frames; use renderer=auto")
    if options.put_back and not options.truth:
        raise InputError("put_back=true: needs the car's position in telemetry; add truth=true")
    if options.laps < 0 or options.seconds < 0:
        raise InputError("laps and seconds must be 0 or more")
    if not all(_is_span(pair) for pair in options.manual):
        raise InputError("manual: must be pairs of seconds such as [[5,7],[20,21]]")


def _is_span(pair: object) -> bool:
    """Return whether a value is a pair of numbers with the smaller one first."""
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        return False
    return all(type(one) in (int, float) for one in pair) and pair[0] < pair[1]
