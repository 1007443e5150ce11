"""Figures with their 95 % intervals as texts and as columns of tables."""

import math
import re
from collections.abc import Iterable
from typing import Protocol


class Bounded(Protocol):
    """A figure with the bounds of its interval; None or NaN where one is not known."""

    @property
    def value(self) -> float | None:
        """Return the figure."""

    @property
    def low(self) -> float | None:
        """Return the lower bound."""

    @property
    def high(self) -> float | None:
        """Return the upper bound."""


def with_interval(figure: Bounded, form: str, factor: float = 1) -> str:
    """Return a figure with its interval, both times a factor.

    >>> from types import SimpleNamespace as Figure
    >>> with_interval(Figure(value=0.9, low=0.8, high=0.95), "{:.0f}", 100)
    '90 (80 to 95)'
    >>> with_interval(Figure(value=None, low=710.0, high=None), "{:.0f}")
    'none (710 or more)'
    >>> with_interval(Figure(value=math.nan, low=math.nan, high=math.nan), "{:.0f}")
    '-'
    """
    value, low, high = (
        None if one is None else form.format(factor * one)
        for one in map(known, (figure.value, figure.low, figure.high))
    )
    if low is None:
        return value or "-"
    value = value or "none"
    return f"{value} ({low} or more)" if high is None else f"{value} ({low} to {high})"


def two_lines(cell: str) -> str:
    r"""Return a text with its interval or deviation in a second line, for a narrow column.

    >>> two_lines("90 (80 to 95)"), two_lines("none (710 or more)"), two_lines("98.2% ± 0.4%")
    ('90\n80..95', 'none\n>= 710', '98.2%\n± 0.4%')
    >>> two_lines("3 of 3 (95 %: 44 % or more)"), two_lines("plain")
    ('3 of 3 (95 %:\n44 % or more)', 'plain')
    """
    interval = re.fullmatch(r"(.+) \(([^:]+)\)", cell)
    if interval is None:
        return cell.replace(" ±", "\n±").replace(": ", ":\n")
    bounds = re.sub("^(.+) or more$", r">= \1", interval[2]).replace(" to ", "..")
    return f"{interval[1]}\n{bounds}"


def interval_figures(name: str, figures: Iterable[Bounded]) -> dict[str, list[float | None]]:
    """Return figures as columns of a table: `NAME`, `NAME_low` and `NAME_high`."""
    found = list(figures)
    return {
        name: [known(one.value) for one in found],
        f"{name}_low": [known(one.low) for one in found],
        f"{name}_high": [known(one.high) for one in found],
    }


def known(value: float | None) -> float | None:
    """Return a finite number; None for NaN, an infinite one and None."""
    return value if value is not None and math.isfinite(value) else None
