"""Keys of `drivezoo simulator record`, `drive` and `client`."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from zoo.base.command_keys import EntryChoice
from zoo.base.errors import InputError
from zoo.simulator.udacity_car import TOP_SPEED_MPH
from zoo.simulator.weather import read_weather
from zoo.simulator.world_settings import WorldSettings

if TYPE_CHECKING:
    from zoo.simulator.simulated_world import World

DIALECTS = "drivezoo.dialects"  # entry points: classes that are derived from `Client`
Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True, kw_only=True)
class DrawnWorld(WorldSettings):
    """A world with camera frames, and the car's start in it.

    Args:
        seed: random seed of the weather.
        start: start position in metres along the road; null for its begin.
        renderer: auto, software or opengl.
    """

    seed: Annotated[int, Field(ge=0)] = 0
    start: float | None = None
    renderer: Literal["auto", "software", "opengl"] = "auto"

    def open(self, renderer: Any = None, **changes: Any) -> "World":
        """Open the world and begin a drive.

        Args:
            renderer: stand-in for the renderer; None for the one of the options.
            changes: arguments of `open_world` in place of the options' own.
        """
        from zoo.simulator.simulated_world import Start, open_world  # slow import: SciPy

        world = open_world(renderer=renderer or self.renderer, **self.place | changes)
        world.reset(self.seed, Start(self.start), read_weather(self.weather))
        return world


@dataclass(frozen=True, kw_only=True)
class RecordedWorld(DrawnWorld):
    """A world whose drives are recorded.

    Args:
        header: whether the log begins with column names, as the course's sample data does.
        relative: whether the log has paths relative to its folder (IMG/...).
    """

    header: bool = False
    relative: bool = False


@dataclass(frozen=True, kw_only=True)
class RecordOptions(RecordedWorld):
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
        jobs: number of processes that draw, 1..64; it does not change the files.
    """

    directions: ClassVar[tuple[int | str, ...]] = (1, -1, "both")

    out: str
    laps: Annotated[float, Field(gt=0, le=1000)] = 1.0
    control: Literal["expert", "keyboard", "mouse"] = "expert"
    speed: Annotated[float, Field(ge=8, le=TOP_SPEED_MPH)] = TOP_SPEED_MPH
    noise: Annotated[float, Field(ge=0, le=1)] = 0.0
    jobs: Annotated[int, Field(ge=1, le=64)] = 1


@dataclass(frozen=True, kw_only=True)
class DriveOptions(RecordedWorld):
    """Keys of a drive by hand.

    Args:
        out: folder of the recording; auto is recordings/ and the time of its start.
        port: TCP port of the page on this machine; 0: a free one.
        seconds: seconds of driving until the end; 0 for no end.
    """

    out: str = "auto"
    port: Annotated[int, Field(ge=0, le=65535)] = 4571
    seconds: Seconds = 0.0


@dataclass(frozen=True, kw_only=True)
class ClientOptions(DrawnWorld):
    """Keys of a client.

    Args:
        url: address of the driver.
        protocol: legacy (the original's Socket.IO of 2016) or modern (python-socketio).
        dialect: udacity, or a fork's messages: maxitwo or udacity_gym; see the manual.
        clock: lockstep (one frame for each reply) or realtime (time passes without replies).
        laps: number of laps until the end; 0 for no end but the end of an open road.
        seconds: seconds of simulated time until the end; 0 for no end.
        film: path of the .mp4 to write; null for none.
        window: whether to show the camera's frames on a page.
        manual: spans of seconds in which a simulated person holds W, [[5,7],[20,21]].
        truth: whether telemetry also has the simulated time, the cross-track error, half the
            road's width and wall contact; the original sends none of them.
        put_back: whether the driver may put the car back on the road; needs truth=true. The
            original has no such command.
        decimal_comma: whether numbers have a decimal comma, as in a German locale.
        drop_at: simulated second at which the connection is dropped once; null for never.
    """

    url: str = "http://127.0.0.1:4567"
    protocol: Literal["legacy", "modern"] = "legacy"
    dialect: Annotated[str, EntryChoice(DIALECTS, own=("udacity",))] = "udacity"
    clock: Literal["lockstep", "realtime"] = "lockstep"
    laps: Seconds = 0.0
    seconds: Seconds = 0.0
    film: str | None = None
    window: bool = False
    manual: tuple[Any, ...] = ()
    truth: bool = False
    put_back: bool = False
    decimal_comma: bool = False
    drop_at: float | None = None

    def check(self) -> None:
        """Raise InputError for a value that is not allowed."""
        super().check()
        if self.put_back and not self.truth:
            raise InputError("put_back=true: needs the car's position in telemetry; add truth=true")
        try:
            ordered = all(0 <= begin < end for begin, end in self.manual)
        except (TypeError, ValueError):
            ordered = False
        if not ordered:
            raise InputError("manual: must be pairs of seconds such as [[5,7],[20,21]]")
