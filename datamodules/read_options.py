"""What a user says about a recording: keys that commands and trainings share."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import Field

from datamodules.steering_unit import SteeringUnit, keys_and_values, read_unit
from zoo.base.errors import UsageError
from zoo.base.key_values import convert
from zoo.base.rig import MPS_PER_MPH
from zoo.base.terminal import counted

MPS_PER = {"mph": MPS_PER_MPH, "mps": 1.0, "kmh": 1 / 3.6}  # m/s of a unit of speed
OWN_KEYS = ("format", "columns", "steering", "camera", "speed_unit")  # that `each` may have


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What a user says about a recording; a format uses what concerns it.

    Args:
        images: folder of the images, if not the usual one.
        on_bad_image: skip: leave out rows whose image is missing.
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
            values = {
                key: convert(f"each: {number}: {key}", kinds[key], value)
                for key, value in said.items()
            }
            options.append(replace(self, **values))
        if keys:
            raise UsageError(
                f"each: {', '.join(keys)}: data.root names {counted(roots, 'recording')}; their "
                f"numbers are 1..{roots}"
            )
        return options

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
                    f"columns: {key}: {name}: must be a column's name, or its position from 0"
                )
        return {key: str(name) for key, name in columns.items()}


def said_in(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a config's `data` says about its recording."""
    return {field.name: data[field.name] for field in fields(ReadOptions) if field.name in data}
