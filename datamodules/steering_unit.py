"""The meaning of a recording's steering numbers: unit, full lock and sign."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from zoo.base.errors import UsageError

EXAMPLE = "unit: deg, full: 540, right: positive"


@dataclass(frozen=True)
class SteeringUnit:
    """What the steering numbers of a source mean.

    Attributes:
        unit: `share` of full lock, `deg` or `rad` of the steering wheel or of the front wheels,
            `servo` for a servo's own numbers, or `px` of a point in the image.
        full: distance from `zero`, in this unit, at which the steering is 1.
        right: sign of a steering to the right.
        zero: number that steers straight ahead.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")
    unit: Literal["share", "deg", "rad", "servo", "px"] = "share"
    full: Annotated[float, Field(gt=0, le=1e6, strict=True)] = 1.0
    right: Literal["positive", "negative"] = "positive"
    zero: Annotated[float, Field(ge=-1e6, le=1e6, strict=True)] = 0.0

    def steering(self, values: Any) -> Any:
        """Return the steering, right positive, 1 at full lock, of values, a float or an array."""
        sign = 1.0 if self.right == "positive" else -1.0
        return (values - self.zero) * (sign / self.full)

    def written(self, steering: Any) -> Any:
        """Return the source's numbers of a steering, the inverse of `steering`."""
        sign = 1.0 if self.right == "positive" else -1.0
        return steering * (sign * self.full) + self.zero

    def key(self) -> str:
        """Return the key that sets this meaning."""
        fields = ", ".join(f"{name}: {value}" for name, value in asdict(self).items() if value != 0)
        return f"steering={{{fields}}}"

    def words(self) -> str:
        """Return the meaning in words, such as `deg, 540 at full lock, right positive`."""
        zero = f", {self.zero:g} straight ahead" if self.zero else ""
        return f"{self.unit}, {self.full:g} at full lock{zero}, right {self.right}"


def keys_and_values(key: str, value: str | Mapping | None) -> Mapping | None:
    """Return the keys and values of a mapping or of its text in braces; None for all else.

    >>> keys_and_values("steering", "{unit: deg, full: 540}"), keys_and_values("steering", "wheel")
    ({'unit': 'deg', 'full': 540}, None)

    Raises:
        UsageError: the text in braces is not YAML, or a key in it has no value.
    """
    if not isinstance(value, str) or not value.startswith("{"):
        return value if isinstance(value, Mapping) else None
    from zoo.base.plain_files import parse_yaml

    try:
        content = parse_yaml(value)
    except ValueError as error:
        raise UsageError(f"{key}={value}: {error}; expected {{NAME: VALUE, NAME: VALUE}}") from None
    assert isinstance(content, Mapping)
    if empty := [str(name) for name, given in content.items() if given is None]:
        raise UsageError(f"{key}: {empty[0]}: has no value; write NAME: VALUE, with a space")
    return content


def read_unit(content: Mapping) -> SteeringUnit:
    """Return a unit from its keys and values.

    Raises:
        UsageError: there is no such unit, or a value is impossible.
    """
    try:
        return TypeAdapter(SteeringUnit).validate_python(dict(content))
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(map(str, first["loc"]))
        raise UsageError(
            f'steering: {name}: {first["msg"].lower()}; for example "steering={{{EXAMPLE}}}"'
        ) from None
