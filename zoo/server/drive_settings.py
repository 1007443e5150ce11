"""Keys of `drivezoo drive` and their checks."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from zoo.base.command_keys import Choice, EntryChoice, Section
from zoo.base.errors import UsageError, placed_errors
from zoo.base.origin import is_loopback
from zoo.driving.scenario import Margin
from zoo.driving.speed_controller import PI, Constant, Network, SpeedController, SteeringFilter
from zoo.server.driven_simulator import SIMULATORS
from zoo.simulator.track_names import recorded_name, short_name

PORT = 4567  # to which the original simulator connects
SIMULATOR_PORT = 9091  # on which the Donkeycar simulator listens
Port = Annotated[int, Field(ge=0, le=65535)]
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
        host: name or address to listen on; of the simulator, with world=donkey.
        port: TCP port; 0: a free one; null: 4567, or 9091 with world=donkey.
        expose: true: other machines may connect and watch, with host=0.0.0.0; the page's buttons
            then need the token in the printed address.
        sim: track on which the embedded simulator drives as the client, such as lake; null: wait
            for another simulator.
        world: donkey: connect to the Donkeycar simulator at host= and port=, and drive there; null:
            wait for a simulator.
        scene: scene of the Donkeycar simulator.
        page: TCP port of the live page with world=donkey; 0: a free one.
        laps: laps after which the embedded or the Donkeycar simulator ends; null: Ctrl-C ends it.
        put_back: true: an intervention puts its car back on the road, as in drivezoo evaluate.
        margin: distance off the centreline that counts as an intervention, m; null: leaving the
            lane.
        record: folder for frames and driving_log.csv; null: write only drive.csv.
        threads: threads of the network; 2 are faster, unless a simulator needs the same cores.
        engine: torch, or onnx for onnxruntime; auto: onnxruntime for a network of 100 million
            multiply-adds a frame or more, if it is installed and steers the same.
        steering: filter of the network's steering.
        speed: speed to hold in mph, or what controls the throttle.
    """

    host: str = "127.0.0.1"
    port: Port | None = None
    expose: bool = False
    sim: str | None = None
    world: Annotated[str, EntryChoice(SIMULATORS)] | None = None
    scene: str = "generated_track"
    page: Port = PORT
    laps: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    put_back: bool = True
    margin: Margin | None = None
    record: Path | None = None
    threads: Annotated[int, Field(ge=1, le=64)] = 1
    engine: Literal["auto", "torch", "onnx"] = "auto"
    steering: Annotated[SteeringFilter, Section()]
    speed: Annotated[SpeedController, Choice(CONTROLLERS, default="pi", number="set_mph")]

    def __post_init__(self) -> None:
        """Replace `~` in the path."""
        if self.record is not None:
            object.__setattr__(self, "record", self.record.expanduser())
        if self.port is None:
            object.__setattr__(self, "port", SIMULATOR_PORT if self.world else PORT)

    @property
    def server(self) -> tuple[str, int]:
        """Return host and port to listen on: for simulators, or for browsers alone."""
        if self.world is None:
            return self.host, PORT if self.port is None else self.port
        return "0.0.0.0" if self.expose else "127.0.0.1", self.page

    @property
    def place(self) -> str | None:
        """Return where it drives, as of the scenario of an evaluation; None if it is unknown."""
        if self.world is not None:
            return f"{self.host}:{self.port}/{self.scene}"
        return self.sim and recorded_name(short_name(self.sim))


def check_settings(settings: DriveSettings) -> None:
    """Check what can be checked before the port is opened.

    Raises:
        UsageError: other machines could connect although `expose` is false; both `sim` and
            `world` are named; or a key changes nothing in the simulator.
        InputError: there is no such track, or its file cannot be read.
    """
    if settings.sim and settings.world:
        raise UsageError(f"sim={settings.sim}: world={settings.world} is driven; drop one")
    idle = ("scene", "page") if settings.sim else ("scene", "page", "laps", "put_back")
    for key in () if settings.world else idle:
        if getattr(settings, key) != getattr(DriveSettings, key):
            raise UsageError(f"{key}: changes nothing here; drop it, or add sim= or world=")
    if settings.sim is not None:
        from zoo.simulator.track_file import read_track  # slow import: scipy

        with placed_errors(f"sim={settings.sim}"):
            read_track(settings.sim)
    if not settings.expose and not is_loopback(settings.server[0]):
        raise UsageError(
            f"host={settings.host}: other machines could connect; add expose=true to allow it"
        )
