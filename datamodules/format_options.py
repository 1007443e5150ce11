"""What a user says about a recording to read or to write, and what a writer returns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import Field

from datamodules.steering_unit import SteeringUnit, keys_and_values, read_unit
from zoo.base.errors import InputError, UsageError
from zoo.base.key_values import convert
from zoo.base.rig import MPS_PER_MPH
from zoo.base.terminal import counted

MPS_PER = {"mph": MPS_PER_MPH, "mps": 1.0, "kmh": 1 / 3.6}  # m/s of a unit of speed
Side = Annotated[int, Field(ge=1, le=4096)]
Progress = Callable[[float], None]  # function called with the finished share, 0..1
OWN_KEYS = ("format", "columns", "steering", "camera", "speed_unit")  # that `each` may have


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What a user says about a recording to read; a format uses what concerns it.

    Args:
        images: folder of the images, if not the usual one.
        on_bad_image: what a replay does with a row whose image is bad; other commands skip it.
        on_bad_row: skip: leave out rows that cannot be read; each is counted.
        format: name of the format, such as table; null: found by the names of the files.
        columns: columns of a table, {image: NAME, steering: NAME}, or their positions from 0.
        steering: what the numbers mean, {unit: deg, full: 540, right: positive}, or the name of the
            number that steers, as LeRobot's action:0; null: as the format says.
        camera: name of the camera that looks ahead, in a LeRobot dataset; null: found by its name.
        speed_unit: unit of a speed whose name has none.
        each: keys of single recordings, by number, {2: {format: table, steering: ...}}.
        rig: name or file of the car's rig, such as donkey_sim; null: rig.yaml beside the recording,
            or as the format says.
        cache: folder in which shards from an address are kept.
        cache_gb: most GB of shards in it; those used longest ago are deleted.
    """

    images: str | None = None
    on_bad_image: Literal["fail", "skip"] = "fail"
    on_bad_row: Literal["fail", "skip"] = "fail"
    format: str | None = None
    columns: str | Mapping[str, str] | None = None
    steering: str | Mapping[str, Any] | None = None
    camera: str | None = None
    speed_unit: Literal["mph", "mps", "kmh"] = "mps"
    each: str | Mapping[Any, Any] | None = None
    rig: str | None = None
    cache: str | None = "outputs/cache"
    cache_gb: Annotated[float, Field(gt=0)] = 20.0

    def of_each(self, roots: int) -> list["ReadOptions"]:
        """Return what the user says about each of some recordings.

        Raises:
            UsageError: `each` names no such recording, an unknown key, or an impossible value.
        """
        typed = keys_and_values("each", {} if self.each is None else self.each)
        if typed is None:
            raise UsageError(f"each={self.each}: must be such as {{2: {{format: table}}}}")
        keys = {str(number): said for number, said in typed.items()}
        kinds = get_type_hints(ReadOptions, include_extras=True)
        options = []
        for number in map(str, range(1, roots + 1)):
            said = keys.pop(number, {})
            if not isinstance(said, Mapping) or not set(said) <= set(OWN_KEYS):
                raise UsageError(f"each: {number}: {said}: expected keys of {', '.join(OWN_KEYS)}")
            values = {key: convert(f"each: {number}: {key}", kinds[key], said[key]) for key in said}
            options.append(replace(self, **values, each=None))
        if keys:
            raise UsageError(
                f"each: {', '.join(keys)}: data.root names {counted(roots, 'recording')}; their "
                f"numbers are 1..{roots}"
            )
        return options

    def check_images(self, faults: Sequence[str], rows: int) -> None:
        """Raise InputError for bad images, unless `on_bad_image` skips them and rows are left.

        Args:
            faults: a line on each row with a bad image.
            rows: number of rows, with these.
        """
        if faults and (self.on_bad_image == "fail" or len(faults) == rows):
            skip = ", or set data.on_bad_image=skip" if len(faults) < rows else ""
            raise InputError(
                f"{faults[0]} ({len(faults):,} of {rows:,} rows have a bad image); copy or record "
                f"the images again{skip}"
            )

    def given(self) -> dict[str, Any]:
        """Return the values that differ from the defaults, by key."""
        plain = ReadOptions()
        return {key: value for key, value in vars(self).items() if value != getattr(plain, key)}

    @property
    def unit(self) -> SteeringUnit | None:
        """Return what the user says that the steering's numbers mean."""
        plain = keys_and_values("steering", self.steering)
        return None if plain is None else read_unit(plain)

    @property
    def steering_name(self) -> str | None:
        """Return the name that the user gives of the number that steers."""
        return self.steering if isinstance(self.steering, str) and self.unit is None else None

    @property
    def named_columns(self) -> Mapping[str, str]:
        """Return the columns that the user names, a position as a text.

        Raises:
            UsageError: one is neither a name nor a position.
        """
        columns = keys_and_values("columns", self.columns) or {}
        for key, name in columns.items():
            if type(name) not in (str, int):
                raise UsageError(
                    f"columns: {key}: {name}: must be a column's name, or its position from 0, as "
                    "in {image: NAME, steering: 3}"
                )
        return {key: str(name) for key, name in columns.items()}


def said_in(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a config's `data` says about its recording."""
    return {field.name: data[field.name] for field in fields(ReadOptions) if field.name in data}


@dataclass(frozen=True, kw_only=True)
class WriteOptions:
    """What a user says about the recording to write; a format uses what concerns it.

    Args:
        fps: LeRobot: frames per second to write; null: the recording's mean.
        crf: LeRobot: quality of the videos, of which 1 is the best and the largest.
        task: LeRobot: the task in words.
        keep: rows to write, 120-180,2600-, from 1; null: all.
        size: rows and columns of the written images, such as [96,96]; null: as they are.
        fit: keep: images as they are; pad: with black bars, twice as wide as high, as the
            simulator's frames are.
        quality: quality of JPEGs written from videos, resized or padded.
        shard_mb: shards: MB of each.
    """

    fps: Annotated[int, Field(ge=1, le=1000)] | None = None
    crf: Annotated[int, Field(ge=1, le=51)] = 18
    task: str = "follow the road"
    keep: str | None = None
    size: tuple[Side, Side] | None = None
    fit: Literal["keep", "pad"] = "keep"
    quality: Annotated[int, Field(ge=1, le=100)] = 95
    shard_mb: Annotated[float, Field(gt=0, le=4000)] = 128


@dataclass(frozen=True)
class Converted:
    """A converted recording.

    Attributes:
        folder: folder that was written.
        rows: number of rows in it.
        drives: number of continuous drives.
        notes: a line on each loss or assumption.
        following: words of the command to type next; empty for `drivezoo check FOLDER`.
        purpose: where or why to type it.
    """

    folder: Path
    rows: int
    drives: int
    notes: tuple[str, ...] = ()
    following: tuple[str, ...] = ()
    purpose: str = ""
