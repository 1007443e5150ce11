"""Suites of the benchmark, `conf/suite/<name>.yaml`: groups of drives on named roads."""

import functools
import hashlib
import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from zoo.base.bounded_files import hash_file
from zoo.base.conf_files import choices, conf_folder
from zoo.base.errors import InputError, UsageError, hint, placed_errors
from zoo.base.limits import check_most
from zoo.base.plain_files import read_like
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario, SpeedMph
from zoo.runs.record_fields import Count, Number, OnlyFields, check_fields
from zoo.simulator.road_family import MOST_SEED, roads_digest
from zoo.simulator.weather import CLEAR, read_weather
from zoo.simulator.world_settings import Quality

LIKE, LAPS, DEV = "like", "laps", "dev"  # groups; LIKE also has the clean partners
USUAL = {"speed", "quality"}  # keys of drives that have none of their own
OVERALL = "all but laps"  # the figures and marks of all groups but LAPS
Share = Annotated[Number, Field(ge=0, le=1)]
NotNegative = Annotated[Number, Field(ge=0)]


class Marks(OnlyFields):
    """The pass marks of a group; a share is 0..1."""

    autonomy: Share = 0.0
    without_intervention: Share = 0.0
    interventions_per_km: NotNegative = 0.0
    m_per_intervention: NotNegative = 0.0
    cte_mean_m: NotNegative = 0.0
    steering_per_s: NotNegative = 0.0


class _Settings(OnlyFields):
    """What differs from a clean drive."""

    weather: dict[str, object] | None = None
    delay_s: Number | None = None
    frame_rate: Number | None = None
    speed: SpeedMph | None = None


class _Drive(_Settings):
    """A drive in the file of a suite; all keys but the track are its settings."""

    track: str


class _Level(_Settings):
    """A level of an axis; all keys but the family of its roads are its settings."""

    family: str


class _File(OnlyFields):
    """The file of a suite."""

    name: str
    groups: dict[str, list[_Drive]] = Field(default_factory=dict)
    axes: dict[str, Annotated[list[_Level], Field(min_length=2)]] = Field(default_factory=dict)
    seed: Count = 0
    roads: Annotated[Count, Field(ge=1, le=1000)] = 12
    dev_roads: Annotated[Count, Field(ge=1, le=1000)] = 2
    data: str | None = None
    speed: SpeedMph = 15.0
    quality: Quality = "full"
    mean_steering: Number | None = None
    dev: list[str] = Field(default_factory=list)
    laps: list[str] = Field(default_factory=list)
    marks: Annotated[dict[str, Marks], Field(min_length=1)] | None = None


class Road(NamedTuple):
    """A drive of a suite: its group, track, and settings as JSON."""

    group: str
    track: str
    settings: str


@dataclass(frozen=True)
class SuiteDrive:
    """A drive of a suite.

    Attributes:
        group: name of the group.
        track: name of the road.
        settings: settings that differ from a clean drive, as in the suite's file.
        scenario: what is driven.
        level: level of the axis that the group is, from 1 on; 0 for another group. A drive of a
            level ends at its first intervention.
    """

    group: str
    track: str
    settings: dict[str, Any]
    scenario: Scenario = field(repr=False)
    level: int = 0

    @property
    def key(self) -> Road:
        """Return what identifies the drive in a suite and in a result."""
        return road_of(self)


@dataclass(frozen=True)
class Suite:
    """Drives that every entry of a benchmark drives.

    Attributes:
        name: name with the version, such as `v1`.
        drives: drives by group; the clean partners of shifted drives are in the group `like`.
        data: config in `conf/data` of the training data.
        mean_steering: mean steering of the training data, -1..1; None where the file has none.
        marks: pass marks of a course by group; empty without marks.
        usual: speed and quality of drives that have none, and hashes of the tracks' files by track.
    """

    name: str
    drives: tuple[SuiteDrive, ...]
    data: str | None
    mean_steering: float | None
    marks: Mapping[str, Marks]
    usual: dict[str, object]

    @functools.cached_property
    def roads(self) -> str:
        """Return 16 hexadecimal digits of the contents of the drawn roads."""
        return roads_digest(dict.fromkeys(drive.track for drive in self.drives))


def road_of(drive: Any) -> Road:
    """Return what identifies a drive in a suite and in a result, which have the same fields."""
    return Road(drive.group, drive.track, json.dumps(drive.settings, sort_keys=True))


def place_of(track: str) -> str:
    """Return the place of a track: roads of one number are one in families with other levels.

    >>> place_of("bends_1:17") == place_of("bends_5:17"), place_of("alpine:17"), place_of("lake")
    (True, 'alpine:17', 'lake')
    """
    return re.sub(r"_\d+(?=:\d+$)", "", track)


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
    for file in dict.fromkeys([other, *suite_names()]):
        included = read_suite_file(suite_path(file)).name
        if name in (included, f"{included}-{DEV}"):
            return file, DEV if name != included else "test"
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
    path = suite_path(name)
    file = read_suite_file(path)
    if taken := {LAPS, DEV, OVERALL} & {*file.groups, *file.axes} | {*file.groups} & {*file.axes}:
        raise InputError(f"{path}: groups.{min(taken)}: is taken; choose another name")
    if split == DEV and not (file.dev or file.axes):
        raise UsageError(f"split=dev: the suite {file.name} has no dev roads; use split=test")
    count = sum(map(len, file.groups.values())) + len(file.dev) + len(file.laps)
    count += file.roads * sum(map(len, file.axes.values()))
    check_most("drives", count, f"{path}: groups", "remove some")
    dev, laps = ([_Drive(track=track) for track in tracks] for tracks in (file.dev, file.laps))
    groups = {DEV: dev} if split == DEV else file.groups | {LAPS: laps}
    drives = [
        _suite_drive(file, path, group, drive) for group, roads in groups.items() for drive in roads
    ]
    drives += _leveled(file, path, split)
    if not drives:
        raise InputError(f"{path}: groups: has no drive; name one road or more")
    counts = Counter(drive.key for drive in drives)
    if twice := [road for road, count in counts.items() if count > 1]:
        raise InputError(f"{path}: groups.{twice[0].group}: {twice[0].track} stands twice")
    partners = [
        _suite_drive(file, path, LIKE, _Drive(track=drive.track))
        for drive in drives
        if drive.settings and not drive.level
    ]
    by_key = {drive.key: drive for drive in drives + partners}
    order = [LIKE, *groups, *file.axes]
    ordered = sorted(by_key.values(), key=lambda drive: order.index(drive.group))
    marks = {} if split == DEV or file.marks is None else file.marks
    names = [*dict.fromkeys(drive.group for drive in ordered), OVERALL]
    for group in marks:
        if group not in names:
            raise InputError(f"{path}: marks.{group}: no such group; {hint(group, names)}")
    name = file.name + (f"-{DEV}" if split == DEV else "")
    files = [drive.track for drive in ordered if drive.track.endswith((".yaml", ".yml"))]
    usual = file.model_dump(include=USUAL) | {name: hash_file(Path(name))[:16] for name in files}
    return Suite(name, tuple(ordered), file.data, file.mean_steering, marks, usual)


def road_numbers(name: str, count: int) -> list[int]:
    """Return numbers of roads, drawn from a name."""
    digest = hashlib.sha256(name.encode()).digest()
    return np.random.default_rng(list(digest)).integers(MOST_SEED, size=count).tolist()


def _leveled(file: _File, path: Path, split: str) -> list[SuiteDrive]:
    """Return the drives of the axes: each level of an axis on roads of the same numbers."""
    seed, count = (0, file.dev_roads) if split == DEV else (file.seed, file.roads)
    drives = []
    for axis, levels in file.axes.items():
        numbers = road_numbers(f"{split} {seed} {axis}", count)
        for level, change in enumerate(levels, 1):
            settings = change.model_dump(exclude_unset=True, exclude={"family"})
            drawn = [_Drive(track=f"{change.family}:{number}", **settings) for number in numbers]
            drives += [_suite_drive(file, path, axis, drive, level) for drive in drawn]
    return drives


def suite_path(name: str) -> Path:
    """Return the file of a suite, which may be missing; raise UsageError for an unknown name."""
    if name.endswith((".yaml", ".yml")):
        return Path(name)
    if name not in suite_names():
        raise UsageError(f"suite={name}: no such suite; {hint(name, suite_names())}")
    return conf_folder() / "suite" / f"{name}.yaml"


def read_suite_file(path: Path) -> _File:
    """Return the contents of a suite's file.

    Raises:
        InputError: the file cannot be read, or a key or value is wrong.
    """
    return check_fields(_File, read_like(path, conf_folder() / "suite"), path)


def _suite_drive(file: _File, path: Path, group: str, drive: _Drive, level: int = 0) -> SuiteDrive:
    settings = drive.model_dump(exclude_unset=True, exclude={"track"})
    with placed_errors(f"{path}: groups.{group}: {drive.track}"):
        weather = read_weather(str(drive.weather)) if drive.weather else CLEAR
        chosen = {key: value for key, value in settings.items() if value is not None}
        usual = file.model_dump(include=USUAL)
        scenario = Scenario(drive.track, **usual | chosen | {"weather": weather})
        scenario.check()
        open_world(scenario, "none").close()
    return SuiteDrive(group, drive.track, settings, scenario, level)
