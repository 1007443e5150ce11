"""Read specs of layers: plain values from an untrusted file, each checked when it is read."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, TypeAdapter, ValidationError, conlist

MOST_TEXT = 40  # characters of a value in a message
MOST_NUMBER, MOST_SIDE = 1e6, 4096
NUMBER = f"a number in {-MOST_NUMBER:g}..{MOST_NUMBER:g}"
Number = Annotated[float, Field(strict=True, ge=-MOST_NUMBER, le=MOST_NUMBER)]
Numbers = Annotated[list[Number], Field(max_length=4096)]
Side = Annotated[int, Field(strict=True, ge=1, le=MOST_SIDE)]
Edge = Annotated[int, Field(strict=True, ge=0, le=MOST_SIDE)]
Shape = tuple[int, ...]
Pair = tuple[int, int]


class LayerSpec:
    """A layer's plain values.

    Args:
        values: `layer`, the layer's class, and its settings, named as in Keras 2.
        label: text on the layer for messages, such as `layer 3 (Conv2D)`.
    """

    def __init__(self, values: Mapping, label: str) -> None:
        self.values, self.label, self.layer = values, label, values["layer"]
        self._read = {"layer", "data_format"}

    def whole(
        self, key: str, default: int | None = None, least: int = 1, most: int = 65_536
    ) -> int:
        """Return a whole number."""
        return self._checked(key, default, _whole(least, most), f"whole, in {least}..{most}")

    def wholes(
        self, key: str, default: list[int] | None = None, least: int = 1, most: int = 65_536
    ) -> list[int]:
        """Return a list of up to 8 whole numbers."""
        kind = conlist(_whole(least, most), max_length=8)
        return self._checked(key, default, kind, f"a list of up to 8 numbers in {least}..{most}")

    def pair(self, key: str, default: Pair | None = None) -> Pair:
        """Return two whole numbers, of rows and columns."""
        return self._checked(key, default, tuple[Side, Side], "a list of two whole numbers")

    def edges(self, key: str) -> tuple[int, int, int, int]:
        """Return whole numbers of `[[top, bottom], [left, right]]`."""
        kind = tuple[tuple[Edge, Edge], tuple[Edge, Edge]]
        vertical, horizontal = self._checked(key, None, kind, "[[top, bottom], [left, right]]")
        return *vertical, *horizontal

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number."""
        return self._checked(key, default, Number, NUMBER)

    def numbers(self, key: str, default: float | None = None) -> list[float]:
        """Return a list of numbers; a single number is a list of one."""
        numbers = self._checked(key, default, Numbers | Number, NUMBER)
        return numbers if isinstance(numbers, list) else [numbers]

    def share(self, key: str) -> float:
        """Return a rate of 0 or more, below 1."""
        rate = self.number(key)
        if not 0 <= rate < 1:
            raise self.wrong(key, "is not a rate of 0 or more, below 1")
        return rate

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        return self._checked(key, default, StrictBool, "true or false")

    def word(self, key: str, words: Sequence[str], default: str | None = None) -> str:
        """Return one of the known words."""
        return self._checked(key, default, Literal[tuple(words)], f"one of {', '.join(words)}")

    def check_all_read(self) -> None:
        """Raise ValueError for a key that the layer does not have."""
        for key in self.values:
            if key not in self._read:
                raise ValueError(f"{self.label}: has no setting {key!r:.{MOST_TEXT}}; remove it")

    def wrong(self, key: str, reason: str) -> ValueError:
        """Return an error about a key's value."""
        return ValueError(f"{self.label}: {key}={self.values.get(key)!r:.{MOST_TEXT}} {reason}")

    def _checked(self, key: str, default: object, kind: Any, what: str) -> Any:
        """Return a value of a type; raise ValueError for a missing one, or one that is not that."""
        self._read.add(key)
        value = self.values.get(key, default)
        if value is None:
            raise ValueError(f"{self.label}: lacks {key}; set it")
        try:
            return TypeAdapter(kind).validate_python(value)
        except ValidationError:
            raise self.wrong(key, f"is not {what}") from None


def _whole(least: int, most: int) -> Any:
    return Annotated[int, Field(strict=True, ge=least, le=most)]


def by(shape: Sequence[int]) -> str:
    """Return a shape as text, such as `66 x 200 x 3`."""
    return " x ".join(map(str, shape)) or "one number"
