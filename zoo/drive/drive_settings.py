"""Keys of `drivezoo drive` and their checks."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from pydantic import Field

from zoo.base.command_keys import Choice, Section
from zoo.base.errors import UsageError, placed_errors
from zoo.drive.origin import is_loopback
from zoo.drives.speed_controller import (
    PI,
    Constant,
    Network,
    SpeedController,
    SteeringFilter,
)
from zoo.worlds.scenario import Margin

_PI = partial(PI, kp=0.1, ki=0.002)  # of the Udacity course
CONTROLLERS = {
    "bends": partial(_PI, set_mph=15.0, bend_mph=5.0),
    "constant": partial(Constant, throttle=0.2),
    "doubt": partial(_PI, set_mph=15.0, doubt_mph=5.0),
    "network": Network,
    "pi": partial(_PI, set_mph=9.0),
    "proportional": partial(PI, set_mph=9.0, kp=0.1),
}


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """Keys of a drive on the socket.

    Args:
        host: name or address to listen on.
        port: TCP port; 0: a free one.
        expose: true: other machines may connect and watch, with host=0.0.0.0; the page's buttons
            then need the token in the printed address.
        sim: track on which the embedded simulator drives as the client, such as lake; null: wait
            for another simulator.
        laps: laps after which the embedded simulator ends; null: Ctrl-C ends it.
        put_back: true: an intervention puts its car back on the road, as in zoo.evaluate.
        margin: distance off the centreline that counts as an intervention, m; null: leaving the
            lane.
        record: folder for frames and driving_log.csv; null: write only drive.csv.
        guard: guard file of drivezoo guard: slows the car down while it fires.
        threads: threads of the network; 2 are faster, unless a simulator needs the same cores.
        steering: filter of the network's steering.
        speed: speed to hold in mph, or what controls the throttle.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 4567
    expose: bool = False
    sim: str | None = None
    laps: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    put_back: bool = True
    margin: Margin | None = None
    record: Path | None = None
    guard: Path | None = None
    threads: Annotated[int, Field(ge=1, le=64)] = 1
    steering: Annotated[SteeringFilter, Section()]
    speed: Annotated[SpeedController, Choice(CONTROLLERS, default="pi", number="set_mph")]

    def __post_init__(self) -> None:
        """Replace `~` in paths."""
        for name in ("record", "guard"):
            if (path := getattr(self, name)) is not None:
                object.__setattr__(self, name, path.expanduser())


def check_settings(settings: DriveSettings) -> None:
    """Check what can be checked before the port is opened.

    Raises:
        UsageError: other machines could connect although `expose` is false.
        InputError: there is no such track, or its file cannot be read.
    """
    if settings.sim is not None:
        from simulator.track_file import read_track  # slow import: scipy

        with placed_errors(f"sim={settings.sim}"):
            read_track(settings.sim)
    if not settings.expose and not is_loopback(settings.host):
        raise UsageError(
            f"host={settings.host}: other machines could connect and drive; to allow it, add "
            "expose=true"
        )
