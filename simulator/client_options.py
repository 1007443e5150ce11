"""What `python -m simulator client` can be told."""

from dataclasses import dataclass, field
from typing import Any

from simulator.errors import SimulatorError
from simulator.legacy_socket import websocket_address
from simulator.world_settings import WorldSettings


@dataclass(frozen=True)
class ClientOptions(WorldSettings):
    """Drive as a driver on the socket commands: the original's autonomous mode.

    On the wire it behaves like the original client of 2016, but for one thing: where nobody listens
    or a driver sends it away, it tries twice a second, not thousands of times.

    Args:
        url: of the driver.
        protocol: legacy, as the original speaks, or modern, as today's libraries do.
        clock: lockstep advances a frame for each reply; realtime drives on meanwhile.
        seed: of the weather.
        start: metres along the lap.
        laps: ends after so many; 0 never does.
        seconds: ends after so many of simulated time; 0 never does.
        film: a path ending in .mp4; null for none.
        window: show what it sees.
        manual: pairs of seconds between which a person holds W, [[5,7],[20,21]].
        truth: send the driver the simulated time, the cross-track error, half the road's width and
            wall contact, too; the original does not.
        put_back: with truth, let the driver have the car put back on the road; the original does
            not.
        decimal_comma: write and read numbers as in a German locale.
        drop_at: the second in which the connection is dropped once; null for never.
        renderer: auto, software or opengl.
    """

    url: str = "http://127.0.0.1:4567"
    protocol: str = "legacy"
    clock: str = "lockstep"
    seed: int = 0
    start: float = 0.0
    laps: float = 0.0
    seconds: float = 0.0
    film: str | None = None
    window: bool = False
    manual: list[Any] = field(default_factory=list)
    truth: bool = False
    put_back: bool = False
    decimal_comma: bool = False
    drop_at: float | None = None
    renderer: str = "auto"


def check_options(options: ClientOptions) -> None:
    """Raises SimulatorError, in one line, for an option that cannot be."""
    choices = {"protocol": ("legacy", "modern"), "clock": ("lockstep", "realtime")}
    options.check()
    for key, known in choices.items():
        if getattr(options, key) not in known:
            raise SimulatorError(f"{key}={getattr(options, key)}: must be {' or '.join(known)}")
    websocket_address(options.url)
    if options.renderer == "none":
        raise SimulatorError("renderer=none: a driver needs pictures; try renderer=auto")
    if options.put_back and not options.truth:
        raise SimulatorError("put_back=true: the driver must see the car leave; add truth=true")
    if options.laps < 0 or options.seconds < 0:
        raise SimulatorError("laps and seconds must be 0 or more")
    if not all(_is_span(pair) for pair in options.manual):
        raise SimulatorError("manual: must be pairs of seconds, [[5,7],[20,21]]")


def _is_span(pair: object) -> bool:
    """Whether it is a pair of numbers, the first the smaller one."""
    if not isinstance(pair, list | tuple) or len(pair) != 2:
        return False
    return all(type(one) in (int, float) for one in pair) and pair[0] < pair[1]
