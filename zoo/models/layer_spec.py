"""Read specs of layers: plain values from an untrusted file, each checked when it is read."""

from collections.abc import Mapping, Sequence

from zoo.base.limits import is_ordinary

MOST_TEXT = 40  # characters of a value in a message
MOST_NUMBER = 1e6
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
        return self._whole(key, self._value(key, default), least, most)

    def wholes(
        self, key: str, default: list[int] | None = None, least: int = 1, most: int = 65_536
    ) -> list[int]:
        """Return a list of up to 8 whole numbers."""
        value = self._list(key, self._value(key, default), 8)
        return [self._whole(key, number, least, most) for number in value]

    def pair(self, key: str, default: Pair | None = None, least: int = 1) -> Pair:
        """Return two whole numbers, of rows and columns."""
        found = self.wholes(key, default and list(default), least, 4096)
        if len(found) != 2:
            raise self.wrong(key, "is not two whole numbers")
        return found[0], found[1]

    def edges(self, key: str) -> tuple[int, int, int, int]:
        """Return whole numbers of `[[top, bottom], [left, right]]`."""
        sides = [self._list(key, side, 2) for side in self._list(key, self._value(key, None), 2)]
        if [len(side) for side in sides] != [2, 2]:
            raise self.wrong(key, "is not [[top, bottom], [left, right]]")
        (top, bottom), (left, right) = sides
        whole = [self._whole(key, edge, 0, 4096) for edge in (top, bottom, left, right)]
        return whole[0], whole[1], whole[2], whole[3]

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number."""
        return self._number(key, self._value(key, default))

    def numbers(self, key: str, default: float | None = None) -> list[float]:
        """Return a list of numbers; a single number is a list of one."""
        value = self._value(key, default)
        many = self._list(key, value, 4096) if isinstance(value, list | tuple) else [value]
        return [self._number(key, number) for number in many]

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

    def _list(self, key: str, value: object, most: int) -> list:
        if not isinstance(value, list | tuple) or not len(value) <= most:
            raise self.wrong(key, f"is not a list of up to {most} values")
        return list(value)

    def _whole(self, key: str, value: object, least: int, most: int) -> int:
        if type(value) is not int or not least <= value <= most:
            raise self.wrong(key, f"is not whole, in {least}..{most}")
        return value

    def _number(self, key: str, value: object) -> float:
        if not is_ordinary(value, most=MOST_NUMBER):
            raise self.wrong(key, f"is not a number in {-MOST_NUMBER:g}..{MOST_NUMBER:g}")
        return float(value)


def by(shape: Sequence[int]) -> str:
    """Return a shape as text, such as `66 x 200 x 3`."""
    return " x ".join(map(str, shape)) or "one number"
