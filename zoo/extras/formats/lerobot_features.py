"""A LeRobotDataset v3: names of its files and columns, and which numbers and cameras are ours.

Written after `lerobot/datasets/utils.py` and `lerobot_dataset.py` of version 0.4.4.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from datamodules.format_options import MPS_PER
from datamodules.formats.table import STEERING_WORD
from zoo.base.errors import InputError, UsageError
from zoo.base.rig import MPS_PER_MPH

# Names of the centre camera, the likeliest first.
CENTRES = ("center", "centre", "front", "front_center", "front_forward", "main", "top", "cam")

_KEY = re.compile(r"[\w.-]{1,200}")
WORDS = {
    "steering": STEERING_WORD,
    "throttle": re.compile(r"throttle|gas\b|gas[ _]pedal|accelerator", re.IGNORECASE),
    "brake": re.compile(r"brake", re.IGNORECASE),
    "speed": re.compile(r"(?<!angular[ _./])(?<!yaw[ _./])(speed|velocity)", re.IGNORECASE),
}
_UNITS = {
    "mph": re.compile(r"(?<!k)mph|mi/h", re.IGNORECASE),
    "kmh": re.compile(r"km/?h|km?ph", re.IGNORECASE),
    "mps": re.compile(r"mps|m/s|ms-1", re.IGNORECASE),
}
VERSION = "v3.0"
ROBOT = "drivezoo"  # robot_type of drivezoo's own datasets
INFO = "meta/info.json"
EPISODES = "meta/episodes"
OLD_EPISODES = "meta/episodes.jsonl"  # of versions 2.0 and 2.1
DATA = "data"
# What info.json has for the same places.
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
# Versions 2.0 and 2.1 have a file for each episode.
OLD_DATA_PATH = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
OLD_VIDEO_PATH = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"

CAMERA_PREFIX = "observation.images."
TIME = "time_s"


@dataclass(frozen=True)
class Component:
    """One number of a feature: the feature's key, the number's position, its name."""

    key: str
    position: int
    name: str

    def __str__(self) -> str:
        return f"{self.key}:{self.position}"


@dataclass(frozen=True)
class Meaning:
    """The components and cameras of a dataset that a log has.

    Attributes:
        roles: component that is the `steering`, and those of `throttle`, `brake` and `speed`
            that exist.
        mph: mph in one unit of the speed.
        cameras: feature's key of center, left, right; None without that camera.
        assumed_unit: whether the speed's name has no unit.
    """

    roles: dict[str, Component]
    mph: float
    cameras: tuple[str, str | None, str | None]
    assumed_unit: bool


def find_meaning(
    features: dict, source: str, steering: str | None, camera: str | None, speed_unit: str
) -> Meaning:
    """Return what the features mean.

    Args:
        features: features of `info.json`, checked to be dicts.
        source: file, for messages.
        steering: component as the user names it, `action:0`; None finds it by its name.
        camera: key of the centre camera; None finds it by its name.
        speed_unit: unit of a speed whose name has none.

    Raises:
        InputError: no steering or camera is found.
        UsageError: what the user names does not exist.
    """
    components = list(_components(features))
    roles = {role: component for role in WORDS if (component := _find(components, role))}
    if steering is not None:
        named = {str(component): component for component in components}
        if steering not in named:
            raise UsageError(f"steering={steering}: {source} has {_list(named)}; name one of them")
        roles["steering"] = named[steering]
    if "steering" not in roles:
        raise InputError(
            f"{source}: no feature's name tells that it steers; name it with steering=, one of "
            f"{_list(map(str, components))}"
        )
    if "brake" in roles and roles["brake"] == roles.get("throttle"):
        del roles["brake"]  # one number for both, `throttle_brake`: below 0 it brakes
    speed = roles.get("speed")
    units = [speed_unit]
    if speed:
        words = f"{speed.key} {speed.name}"
        units = [unit for unit, pattern in _UNITS.items() if pattern.search(words)]
    mph = MPS_PER[units[0] if units else speed_unit] / MPS_PER_MPH
    return Meaning(roles, mph, _cameras(features, source, camera), assumed_unit=not units)


def _components(features: dict) -> Iterator[Component]:
    for key, feature in features.items():
        shape = feature.get("shape")
        if not str(feature.get("dtype")).startswith("float") or key == "timestamp":
            continue
        if not isinstance(shape, list | tuple) or len(shape) != 1 or not isinstance(shape[0], int):
            continue
        names = _flat(feature.get("names"))
        if len(names) != shape[0]:
            names = [""] * min(shape[0], 1000)
        yield from (Component(key, position, name) for position, name in enumerate(names))


def _flat(names: object) -> list[str]:
    """Return the names of a feature's numbers: a list, or lists in a dict."""
    if isinstance(names, dict):
        return [name for part in names.values() for name in _flat(part)]
    return [str(name) for name in names] if isinstance(names, list) else []


def _find(components: list[Component], role: str) -> Component | None:
    """Return the likeliest component: an own column, then an action's, or a state's for speed."""
    words, first = WORDS[role], "observation" if role == "speed" else "action"
    exact = [
        component
        for component in components
        if component.key in (role, f"{role}_mph") and not component.name
    ]
    named = [component for component in components if words.search(component.name)]
    named += [
        component for component in components if words.search(component.key) and not component.name
    ]
    likely = [part for part in named if part.key.startswith(first) or role == "speed"]
    likely.sort(key=lambda part: not part.key.startswith(first))
    return next(iter(exact + likely), None)


def _cameras(features: dict, source: str, camera: str | None) -> tuple[str, str | None, str | None]:
    keys = [key for key, feature in features.items() if feature.get("dtype") in ("video", "image")]
    for key in keys:
        if not _KEY.fullmatch(key) or set(key) == {"."}:
            raise InputError(
                f"{source}: the camera {key!r:.80} is no plain name; rename the feature"
            )
    if camera is not None:
        likely = [key for key in keys if key in (camera, CAMERA_PREFIX + camera)]
        if not likely:
            raise UsageError(f"camera={camera}: {source} has {_list(keys)}; name one of them")
    else:
        likely = [CAMERA_PREFIX + name for name in CENTRES if CAMERA_PREFIX + name in keys]
        likely += [name for name in CENTRES if name in keys] + keys * (len(keys) == 1)
        if not likely:
            raise InputError(
                f"{source}: no camera's name tells that it looks ahead; name it with camera=, one "
                f"of {_list(keys)}"
            )
    centre = likely[0]
    left, right = (
        key if (key := CAMERA_PREFIX + side) in keys and key != centre else None
        for side in ("left", "right")
    )
    return centre, left, right


def _list(names: Iterable[str]) -> str:
    return ", ".join([*names][:20]) or "none"


def video_file(key: str, chunk: int, file: int) -> str:
    """Return the path of a camera's video in the dataset."""
    return VIDEO_PATH.format(video_key=key, chunk_index=chunk, file_index=file)
