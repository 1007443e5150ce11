"""Read the spec of a layer, plain values from an untrusted file, with a check of each value."""

from collections.abc import Mapping, Sequence

from zoo.base.limits import is_ordinary

MOST_TEXT = 40  # characters of a value in a message


class LayerSpec:
    """A layer's plain values; every value is checked when it is read.

    Args:
        values: `layer`, the layer's class, and its settings, named as in Keras 2.
        label: text on the layer for messages, such as `layer 3 (Conv2D)`.
    """

    def __init__(self, values: Mapping, label: str) -> None:
        self.values, self.label = values, label
        self._read = {"layer", "data_format"}

    def whole(
        self, key: str, default: int | None = None, least: int = 1, most: int = 65_536
    ) -> int:
        """Return a whole number."""
        return self._whole(key, self._value(key, default), least, most)

    def number(self, key: str, default: float | None = None, most: float = 1e6) -> float:
        """Return a finite number in -most..most."""
        return self._number(key, self._value(key, default), most)

    def share(self, key: str) -> float:
        """Return a rate of 0 or more, below 1."""
        rate = self.number(key)
        if not 0 <= rate < 1:
            raise self.wrong(key, "is not a rate of 0 or more, below 1")
        return rate

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._value(key, default)
        if not isinstance(value, bool):
            raise self.wrong(key, "is not true or false")
        return value

    def word(self, key: str, known: Sequence[str], default: str | None = None) -> str:
        """Return one of the known words."""
        value = self._value(key, default)
        if not isinstance(value, str) or value not in known:
            raise self.wrong(key, f"is not one of {', '.join(known)}")
        return value

    def wholes(
        self, key: str, default: list[int] | None = None, least: int = 1, most: int = 65_536
    ) -> list[int]:
        """Return a list of up to 8 whole numbers."""
        value = self._value(key, default)
        if not isinstance(value, list | tuple) or len(value) > 8:
            raise self.wrong(key, "is not a list of whole numbers")
        return [self._whole(key, one, least, most) for one in value]

    def pair(
        self, key: str, default: list[int] | None = None, least: int = 1, most: int = 4096
    ) -> tuple[int, int]:
        """Return two whole numbers, of rows and columns."""
        found = self.wholes(key, default, least, most)
        if len(found) != 2:
            raise self.wrong(key, "is not two whole numbers")
        return found[0], found[1]

    def edges(self, key: str) -> tuple[int, int, int, int]:
        """Return whole numbers of `[[top, bottom], [left, right]]`."""
        value = self._value(key, None)
        if not isinstance(value, list | tuple) or [
            len(one) if isinstance(one, list | tuple) else 0 for one in value
        ] != [2, 2]:
            raise self.wrong(key, "is not [[top, bottom], [left, right]]")
        (top, bottom), (left, right) = value
        numbers = [self._whole(key, one, 0, 4096) for one in (top, bottom, left, right)]
        return numbers[0], numbers[1], numbers[2], numbers[3]

    def numbers(self, key: str, default: float | None = None, most: float = 1e6) -> list[float]:
        """Return a list of numbers; a single number is a list of one."""
        value = self._value(key, default)
        many = value if isinstance(value, list | tuple) else [value]
        if not 0 < len(many) <= 4096:
            raise self.wrong(key, "is not a number or a list of them")
        return [self._number(key, one, most) for one in many]

    def check_all_read(self) -> None:
        """Raise ValueError for a key that the layer does not have."""
        for key in self.values:
            if key not in self._read:
                raise ValueError(f"{self.label}: has no setting {key!r:.{MOST_TEXT}}; remove it")

    def wrong(self, key: str, reason: str) -> ValueError:
        """Return an error about a key's value."""
        return ValueError(f"{self.label}: {key}={self.values.get(key)!r:.{MOST_TEXT}} {reason}")

    def _value(self, key: str, default: object) -> object:
        self._read.add(key)
        value = self.values.get(key, default)
        if value is None:
            raise ValueError(f"{self.label}: lacks {key}; set it")
        return value

    def _whole(self, key: str, value: object, least: int, most: int) -> int:
        if type(value) is not int or not least <= value <= most:
            raise self.wrong(key, f"is not whole, in {least}..{most}")
        return value

    def _number(self, key: str, value: object, most: float) -> float:
        if not is_ordinary(value, most=most):
            raise self.wrong(key, f"is not a number in {-most:g}..{most:g}")
        return float(value)
