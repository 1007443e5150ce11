"""Types of fields for the records, and a one-line message for a wrong field."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from zoo.base.errors import InputError

Record = TypeVar("Record", bound=BaseModel)
LARGEST = 1e300

WORDS = {
    "missing": "is missing",
    "extra_forbidden": "no such key",
    "float_type": "should be a number",
    "int_type": "should be a whole number",
    "string_type": "should be text",
    "bool_type": "should be true or false",
    "list_type": "should be a list",
    "dict_type": "should be keys and values",
    "model_type": "should be keys and values",
    "model_attributes_type": "should be keys and values",
}


class Fields(BaseModel):
    """A file's fields, with strict types and with unknown keys kept."""

    model_config = ConfigDict(strict=True, extra="allow", frozen=True, protected_namespaces=())


class OnlyFields(Fields):
    """A file's fields, without unknown keys."""

    model_config = ConfigDict(extra="forbid")


def finite(value: object) -> object:
    """Return a value; raise ValueError for a NaN or infinite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    if not abs(value) < LARGEST:  # also false for NaN
        raise ValueError("should be a finite number")
    return value


def _pair(value: object) -> object:
    mean, deviation = value if isinstance(value, list) and len(value) == 2 else (None, None)
    for one in (mean, 0 if deviation is None else deviation):
        if isinstance(one, bool) or not isinstance(one, int | float):
            raise ValueError("should be two numbers, mean and deviation")
        finite(one)
    return value


def _texts(value: object) -> object:
    if not all(isinstance(one, str) for one in (value if isinstance(value, list) else [value])):
        raise ValueError("should be text, or a list of texts")
    return value


Number = Annotated[float, BeforeValidator(finite)]
Whole = Annotated[int, BeforeValidator(finite)]
Count = Annotated[int, BeforeValidator(finite), Field(ge=0)]
Pair = Annotated[list, BeforeValidator(_pair)]  # mean over drives, and deviation or null

# Of a figure over drives: mean; sample standard deviation, None without one.
Spread = tuple[float, float | None]
Texts = Annotated[object, BeforeValidator(_texts)]


class Figures(Fields):
    """A track's figures: counts of its drives, and the mean and spread of each metric."""

    drives: Count | None = None
    drives_without_intervention: Count | None = None
    __pydantic_extra__: dict[str, Pair | None] = Field(init=False)


def check_fields(kind: type[Record], found: object, place: Path | str) -> Record:
    """Return a record of plain containers; raise InputError that names the first wrong field."""
    if not isinstance(found, Mapping):
        raise InputError(f"{place}: should be keys and values")
    try:
        return kind.model_validate(found)
    except ValidationError as error:
        errors = error.errors(include_url=False, include_input=False)
    first = next((one for one in errors if one["type"] == "extra_forbidden"), errors[0])
    names = [str(one) for one in first["loc"]]
    found_wrong = WORDS.get(first["type"]) or first["msg"].removeprefix("Value error, ")
    raise InputError(f"{place}: {'.'.join(names)}: {found_wrong}")


def plain(record: Fields) -> dict:
    """Return the fields that the file has, as plain containers."""
    return record.model_dump(exclude_unset=True)
