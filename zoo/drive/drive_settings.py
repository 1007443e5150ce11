"""Options of `drivezoo drive`, from `conf/drive.yaml` and `conf/drive/speed`."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from hydra.errors import HydraException
from hydra.utils import instantiate
from pydantic import Field

from simulator.track_file import read_track
from zoo.base.errors import InputError, UsageError
from zoo.cli.command_config import check_options, read_keys
from zoo.drive.origin import is_loopback
from zoo.drives.speed_controller import SpeedController
from zoo.drives.steering_filter import SteeringFilter
from zoo.worlds.scenario import Margin

_SPEED = re.compile(r"(drive\.)?speed=(?P<mph>[-+]?[\d.].*)")


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """Options of a drive; `conf/drive.yaml` has their meanings and defaults."""

    host: str
    port: Annotated[int, Field(ge=0, le=65535)]
    expose: bool
    sim: str | None
    laps: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None
    put_back: bool
    margin: Margin | None
    record: Path | None
    guard: Path | None
    threads: Annotated[int, Field(ge=1, le=64)]
    steering: SteeringFilter
    speed: SpeedController


def read_settings(arguments: Sequence[str]) -> DriveSettings:
    """Return the settings with `port=4568`, `speed=bends` and other arguments applied.

    A number is the speed to hold: `speed=15` means `speed.set_mph=15`.

    Raises:
        UsageError: a key or choice is unknown, or a value has the wrong type or range.
        InputError: there is no such track, or its file cannot be read.
    """
    held = [_SPEED.sub(r"speed.set_mph=\g<mph>", one) for one in arguments]
    settings = read_keys("drive", held)
    try:
        controller = instantiate(settings["speed"], _convert_="all")
    except HydraException as error:
        raise _own_error(error) from None
    constructed = {"steering": SteeringFilter(**settings["steering"]), "speed": controller}
    if settings["record"] is not None:
        constructed["record"] = Path(settings["record"]).expanduser()
    if settings["guard"] is not None:
        constructed["guard"] = Path(settings["guard"]).expanduser()
    found = check_options(DriveSettings, settings | constructed)
    if found.sim is not None:
        try:
            read_track(found.sim)  # before the port is opened
        except InputError as error:
            raise InputError(f"sim={found.sim}: {error}") from None
    if not found.expose and not is_loopback(found.host):
        raise UsageError(
            f"host={found.host}: other machines could connect and drive; to allow it, add "
            "expose=true"
        )
    return found


def _own_error(error: Exception) -> InputError:
    cause = error
    while cause.__cause__ is not None and not isinstance(cause, InputError):
        cause = cause.__cause__
    return UsageError(" ".join(str(cause).split()))
