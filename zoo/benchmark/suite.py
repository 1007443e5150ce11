"""Suites of the benchmark, `conf/suite/<name>.yaml`: groups of drives on named roads."""

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field

from simulator.road_family import roads_digest
from simulator.weather import CLEAR, read_weather
from zoo.base.bounded_files import read_yaml
from zoo.base.errors import InputError, UsageError
from zoo.base.limits import check_most
from zoo.base.nearest import hint
from zoo.benchmark.marks import Mark, read_marks
from zoo.cli.conf_files import choices, conf_folder
from zoo.runs.record_fields import Fields, Number, check_fields
from zoo.worlds.open_world import open_world
from zoo.worlds.scenario import Scenario, SpeedMph

LIKE, LAPS, DEV = "like", "laps", "dev"  # groups; LIKE also has the clean partners


class _Drive(Fields):
    """A drive in the file of a suite; all keys but the track are its settings."""

    track: str
    weather: dict[str, object] | None = None
    delay_s: Number | None = None
    frame_rate: Number | None = None
    speed: SpeedMph | None = None


class _File(Fields):
    """The file of a suite."""

    name: str
    groups: dict[str, list[_Drive]]
    data: str | None = None
    speed: SpeedMph = 15.0
    quality: Literal["full", "simple"] = "full"
    mean_steering: Number | None = None
    dev: list[str] = Field(default_factory=list)
    laps: list[str] = Field(default_factory=list)
    marks: object = None


@dataclass(frozen=True)
class SuiteDrive:
    """A drive of a suite.

    Attributes:
        group: name of the group.
        track: name of the road.
        settings: settings that differ from a clean drive, as in the suite's file.
        scenario: what is driven.
    """

    group: str
    track: str
    settings: dict[str, Any]
    scenario: Scenario = field(repr=False)

    @property
    def key(self) -> tuple[str, str, str]:
        """Return what identifies the drive in a suite and in a result."""
        return drive_key(self.group, self.track, self.settings)


@dataclass(frozen=True)
class Suite:
    """Drives that every entry of a benchmark drives.

    Attributes:
        name: name with the version, such as `v1`.
        drives: drives by group; the clean partners of shifted drives are in the group `like`.
        data: config in `conf/data` of the training data.
        mean_steering: mean steering of the training data, -1..1; None where the file has none.
        marks: pass marks of a course; empty without marks.
    """

    name: str
    drives: tuple[SuiteDrive, ...]
    data: str | None
    mean_steering: float | None
    marks: tuple[Mark, ...]

    @property
    def roads(self) -> str:
        """Return 16 hexadecimal digits of the contents of the drawn roads."""
        return roads_digest(dict.fromkeys(one.track for one in self.drives))


def drive_key(group: str, track: str, settings: dict[str, Any]) -> tuple[str, str, str]:
    """Return what identifies a drive in a suite and in a result.

    >>> drive_key("looks", "alpine:17", {"weather": {"wet": 1.0, "fog": 0.5}})
    ('looks', 'alpine:17', '{"weather": {"fog": 0.5, "wet": 1.0}}')
    """
    return group, track, json.dumps(settings, sort_keys=True)


def suite_names() -> list[str]:
    """Return the names of the included suites, sorted."""
    return choices("suite")


def find_suite(name: str, other: str) -> tuple[str, str]:
    """Return path or name, and split, of the suite that a result names.

    Args:
        name: suite as a result names it, such as `v1` or `v1-dev`.
        other: suite's name or path to look at first; included suites follow.

    Raises:
        InputError: no suite has that name.
    """
    for one in dict.fromkeys([other, *suite_names()]):
        own = _read_file(_path(one)).name
        if name in (own, f"{own}-{DEV}"):
            return one, DEV if name != own else "test"
    raise InputError(
        f"suite: {name} is not included; name its file with suite=PATH, or use the drivezoo that "
        f"drove it (included: {', '.join(suite_names())})"
    )


def read_suite(name: str, split: str = "test") -> Suite:
    """Read a suite by its name or by the path of its YAML file, and check every drive.

    Args:
        name: name in `conf/suite`, or path of a .yaml file.
        split: `test` for the groups; `dev` for the roads to tune on, as the only group.

    Raises:
        UsageError: there is no such suite, or it has no roads of the split.
        InputError: the file cannot be read, a key or value is wrong, or there is no such road.
    """
    path = _path(name)
    file, own = _read_file(path), ""
    given = [*file.groups.values(), file.dev, file.laps]
    check_most("drives", sum(map(len, given)), f"{path}: groups", "remove some")
    groups = file.groups | {LAPS: [_Drive(track=one) for one in file.laps]}
    if split == DEV:
        if not file.dev:
            raise UsageError(f"split=dev: the suite {file.name} has no dev roads; use split=test")
        groups, own = {DEV: [_Drive(track=one) for one in file.dev]}, f"-{DEV}"
    drives = [
        _suite_drive(file, path, group, one) for group, given in groups.items() for one in given
    ]
    if not drives:
        raise InputError(f"{path}: groups: has no drive; name one road or more")
    counts = Counter(one.key for one in drives)
    if twice := [one for one in drives if counts[one.key] > 1]:
        raise InputError(
            f"{path}: groups.{twice[0].group}: {twice[0].track} stands twice; remove one"
        )
    partners = [
        _suite_drive(file, path, LIKE, _Drive(track=one.track)) for one in drives if one.settings
    ]
    by_key = {one.key: one for one in drives + partners}
    order = [LIKE, *groups]
    ordered = sorted(by_key.values(), key=lambda one: order.index(one.group))
    names = list(dict.fromkeys(one.group for one in ordered))
    marks = [] if own or file.marks is None else read_marks(file.marks, names, path)
    return Suite(file.name + own, tuple(ordered), file.data, file.mean_steering, tuple(marks))


def _path(name: str) -> Path:
    if name.endswith((".yaml", ".yml")):
        return Path(name)
    if name not in suite_names():
        raise UsageError(f"suite={name}: no such suite; {hint(name, suite_names())}")
    return conf_folder() / "suite" / f"{name}.yaml"


def _read_file(path: Path) -> _File:
    found = read_yaml(path)
    _check_keys(found, path)
    return check_fields(_File, found, path)


def _suite_drive(file: _File, path: Path, group: str, drive: _Drive) -> SuiteDrive:
    settings = drive.model_dump(exclude_unset=True, exclude={"track"})
    try:
        weather = read_weather(str(drive.weather)) if drive.weather else CLEAR
        known = {key: value for key, value in settings.items() if value is not None}
        usual = {"speed": file.speed, "quality": file.quality}
        scenario = Scenario(drive.track, **usual | known | {"weather": weather})
        scenario.check()
        open_world(scenario, "none").close()
    except InputError as error:
        raise InputError(f"{path}: groups.{group}: {drive.track}: {error}") from None
    return SuiteDrive(group, drive.track, settings, scenario)


def _check_keys(found: object, path: Path) -> None:
    """Raise InputError for a key that a suite or one of its drives does not have."""
    if not isinstance(found, dict):
        return  # `check_fields` reports it
    _check_known(found, _File, str(path))
    groups = found.get("groups")
    for group, drives in groups.items() if isinstance(groups, dict) else ():
        for drive in drives if isinstance(drives, list) else ():
            if isinstance(drive, dict):
                _check_known(drive, _Drive, f"{path}: groups.{group}")


def _check_known(found: Iterable[object], kind: type[BaseModel], place: str) -> None:
    known: Sequence[str] = list(kind.model_fields)
    for key in found:
        if key not in known:
            raise InputError(f"{place}: {key}: no such key; {hint(str(key), known)}")
