"""Types of fields for the records, and a one-line message for a wrong field."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, ValidationError

from zoo.base.errors import InputError

Record = TypeVar("Record", bound=BaseModel)

WORDS = {
    "missing": "is missing",
    "extra_forbidden": "no such key",
    "float_type": "should be a number",
    "finite_number": "should be a finite number",
    "int_type": "should be a whole number",
    "string_type": "should be text",
    "bool_type": "should be true or false",
    "list_type": "should be a list",
    "tuple_type": "should be two numbers, mean and deviation",
    "dict_type": "should be keys and values",
    "model_type": "should be keys and values",
    "model_attributes_type": "should be keys and values",
}


class Fields(BaseModel):
    """A file's fields, with strict types and with unknown keys kept."""

    model_config = ConfigDict(
        strict=True, extra="allow", frozen=True, allow_inf_nan=False, protected_namespaces=()
    )


class OnlyFields(Fields):
    """A file's fields, without unknown keys."""

    model_config = ConfigDict(extra="forbid")


def _texts(value: object) -> object:
    if not all(isinstance(text, str) for text in (value if isinstance(value, list) else [value])):
        raise ValueError("should be text, or a list of texts")
    return value


MOST_WHOLE = 2**53  # above it, a number in a table would no longer be exact
Number = float
Whole = Annotated[int, Field(ge=-MOST_WHOLE, le=MOST_WHOLE)]
Count = Annotated[int, Field(ge=0, le=MOST_WHOLE)]
# Mean over drives, and deviation or null; strict types would refuse a list.
Pair = Annotated[tuple[Number, Number | None], Strict(False)]

# Of a figure over drives: mean; sample standard deviation, None without one.
Spread = tuple[float, float | None]
Texts = Annotated[object, BeforeValidator(_texts)]


class Figures(Fields):
    """A track's figures: counts of its drives, and the mean and spread of each metric."""

    drives: Count | None = None
    drives_without_intervention: Count | None = None
    __pydantic_extra__: dict[str, Pair | None] = Field(init=False)


def check_fields(kind: type[Record], content: object, place: Path | str) -> Record:
    """Return a record of plain containers; raise InputError that names the first wrong field."""
    if not isinstance(content, Mapping):
        raise InputError(f"{place}: should be keys and values")
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        errors = error.errors(include_url=False, include_input=False)
    first = next((fault for fault in errors if fault["type"] == "extra_forbidden"), errors[0])
    names = [str(key) for key in first["loc"]]
    found_wrong = WORDS.get(first["type"]) or first["msg"].removeprefix("Value error, ")
    raise InputError(f"{place}: {'.'.join(names)}: {found_wrong}")


def plain(record: Fields) -> dict:
    """Return the fields that the file has, as plain containers."""
    return record.model_dump(exclude_unset=True)
