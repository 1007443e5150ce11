"""The options of `python -m zoo.drive`: `conf/drive.yaml` and `conf/drive/speed`, checked."""

import difflib
from dataclasses import dataclass
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.errors import HydraException
from hydra.utils import instantiate
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from datamodules.errors import InputError
from zoo.cli.compose import choices, conf_folder
from zoo.drive.origin import is_loopback
from zoo.drives.interventions import LEAST_MARGIN_M
from zoo.drives.speed_controller import SpeedController
from zoo.drives.steering_filter import SteeringFilter

SPEED, RECORD = "drive.speed", "drive.record"
HELP = "python -m zoo.drive --help lists all"


@dataclass(frozen=True)
class DriveSettings:
    """What `conf/drive.yaml` says, in the same order."""

    host: str
    port: int
    expose: bool
    sim: str | None
    laps: float | None
    put_back: bool
    margin: float | None
    record: Path | None
    threads: int
    steering: SteeringFilter
    speed: SpeedController


def read_settings(overrides: list[str]) -> DriveSettings:
    """The settings with the overrides applied, such as `drive.port=4568` or `drive.speed=constant`.

    Raises:
        InputError: no such key or choice, with the nearest; or a value that cannot be.
    """
    config = compose_drive(overrides)
    settings = dict(config["drive"])
    _check("host", settings["host"], isinstance(settings["host"], str), "a name or an address")
    _check("port", settings["port"], _is_whole(settings["port"], 0, 65535), "a port, 0..65535")
    _check("expose", settings["expose"], isinstance(settings["expose"], bool), "true or false")
    _check("threads", settings["threads"], _is_whole(settings["threads"], 1, 64), "in 1..64")
    _check(
        "put_back", settings["put_back"], isinstance(settings["put_back"], bool), "true or false"
    )
    laps, margin = settings["laps"], settings["margin"]
    good = laps is None or (_is_number(laps) and 0 < laps < 10**6)
    _check("laps", laps, good, "a number above 0")
    good = margin is None or (_is_number(margin) and LEAST_MARGIN_M <= margin < 10**6)
    _check("margin", margin, good, f"metres, {LEAST_MARGIN_M} or more, or null")
    if not settings["expose"] and not is_loopback(settings["host"]):
        raise InputError(
            f"drive.host={settings['host']} lets other machines drive by this checkpoint; "
            "if they may, add drive.expose=true"
        )
    record, steering, speed = (settings.pop(key) for key in ("record", "steering", "speed"))
    try:
        controller = instantiate(speed, _convert_="all")
    except HydraException as error:
        raise _own_error(error) from None
    return DriveSettings(
        record=None if record is None else Path(record).expanduser(),
        steering=SteeringFilter(**steering),
        speed=controller,
        **settings,
    )


def compose_drive(overrides: list[str]) -> dict:
    """The config as plain containers; the same errors as `read_settings`."""
    arguments, record = [], None
    for override in overrides:
        key, equals, value = override.partition("=")
        if not equals:
            raise InputError(f"{override}: is no option; they are written key=value, {HELP}")
        if key == SPEED:
            known = choices("drive/speed")
            if value not in known:
                raise InputError(f"{override}: no such choice; there are {', '.join(known)}")
            key = "drive/speed"
        elif key == RECORD:
            # A folder is taken as it stands: Hydra reads none of its characters.
            record = None if value in ("null", "") else value
            continue
        arguments.append(f"{key}={value}")
    with initialize_config_dir(str(conf_folder().resolve()), version_base="1.3"):
        chosen = [one for one in arguments if one.startswith("drive/speed=")]
        known = _keys(_compose(chosen))
        for key in (one.partition("=")[0] for one in arguments if one not in chosen):
            if key not in known:
                raise InputError(f"{key}: no such key; {nearest(key, [*known, SPEED])}")
        config = _compose(arguments)
    config["drive"]["record"] = record
    return config


def nearest(word: str, known: list[str]) -> str:
    """The one or two of `known` that a typo is nearest to. The last part counts, too."""
    tails = {name.rpartition(".")[2]: name for name in known}
    near = difflib.get_close_matches(word, known, n=2, cutoff=0.6)
    for tail in difflib.get_close_matches(word.rpartition(".")[2], list(tails), n=2, cutoff=0.7):
        near += [tails[tail]] if tails[tail] not in near else []
    return f"did you mean {' or '.join(near[:2])}?" if near else HELP


def _compose(arguments: list[str]) -> dict:
    try:
        return OmegaConf.to_container(compose("drive", arguments), resolve=True)
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(f"{str(error).splitlines()[0]} (in: {' '.join(arguments)})") from None


def _keys(node: dict, prefix: str = "") -> list[str]:
    keys = []
    for key, value in node.items():
        deeper = isinstance(value, dict)
        keys += _keys(value, f"{prefix}{key}.") if deeper else [f"{prefix}{key}"]
    return [key for key in keys if not key.endswith("_target_")]


def _own_error(error: Exception) -> InputError:
    cause = error
    while cause.__cause__ is not None and not isinstance(cause, InputError):
        cause = cause.__cause__
    return InputError(" ".join(str(cause).split()))


def _check(key: str, value: object, good: bool, wanted: str) -> None:
    if not good:
        raise InputError(f"drive.{key}={value} is not {wanted}")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_whole(value: object, least: int, most: int) -> bool:
    return type(value) is int and least <= value <= most
