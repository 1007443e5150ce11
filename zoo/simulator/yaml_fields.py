"""Fields of users' YAML files, and a one-line error with the key, the value and what it must be."""

import re
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from zoo.base.errors import InputError, hint


class Keys(BaseModel):
    """Keys and values without unknown keys; a key without a value counts as left out."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def known(cls, content: object) -> object:
        """Return the keys with a value; raise ValueError for a key that does not exist."""
        names = [field.alias or name for name, field in cls.model_fields.items()]
        if not isinstance(content, dict):
            raise ValueError(f"{content!s:.200}; must be keys and values ({', '.join(names)})")
        for name in content:
            if name not in names:
                raise ValueError(f"unknown key {name!s:.80}; {hint(str(name), names)}")
        return {name: value for name, value in content.items() if value is not None}


Made = TypeVar("Made", bound=Keys)


def number(low: float, high: float) -> Any:
    """Return the mark of a finite number in a range, for an `Annotated` type."""
    return Field(strict=True, ge=low, le=high, allow_inf_nan=False)


def _no_text(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("must be a whole number")
    return value


Whole = Annotated[int, BeforeValidator(_no_text), Field(ge=0, le=10_000)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Flag = Annotated[bool, Field(strict=True)]


def read_keys(kind: type[Made], content: object) -> Made:
    """Return the keys of a file's content; raise InputError for the first wrong value."""
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    first = min(errors, key=lambda error: error["type"] == "missing")
    path = ""
    for name in first["loc"]:
        path += f", number {name + 1}" if isinstance(name, int) else f": {name}"
    reason = first["msg"].removeprefix("Value error, ").partition(" after validation")[0]
    reason = re.sub("^(Input|List|Tuple) should", "must", reason)
    if first["type"] == "missing":
        reason = "must be given"
    elif first["type"] not in ("value_error", "too_long") or reason.startswith("must be"):
        reason = f"{first['input']!s:.200}; {reason}"
    raise InputError(f"{path}: {reason}".removeprefix(": "))
