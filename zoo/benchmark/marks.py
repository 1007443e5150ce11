"""Pass marks of a course: figures that an entry of the benchmark must reach.

A suite's file has them by group: `marks: {like: {autonomy: 0.9, cte_mean_m: 0.8}}`. The group
`headline` has the autonomy of the whole suite. A figure that is better when it is lower, such as
`cte_mean_m`, must not be above its mark.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from zoo.base.errors import InputError
from zoo.cli.nearest import hint

HEADLINE = "headline"  # the group of the whole suite's figure, which is an autonomy
# Heading, format and whether higher is better.
FIGURES = {
    "autonomy": ("autonomy", "{:.1%}", True),
    "without_intervention": ("drives without intervention", "{:.1%}", True),
    "m_per_intervention": ("metres per intervention", "{:,.0f}", True),
    "cte_mean_m": ("mean error, m", "{:.2f}", False),
    "steering_per_s": ("steering change, 1/s", "{:.2f}", False),
}
SHARES = ("autonomy", "without_intervention")


@dataclass(frozen=True)
class Mark:
    """A figure that an entry must reach.

    Attributes:
        group: group of the suite, or `headline`.
        figure: name of the figure, one of `FIGURES`.
        value: smallest value that passes; the largest one where lower is better.
    """

    group: str
    figure: str
    value: float

    @property
    def heading(self) -> str:
        """Return the figure's name and unit in words."""
        return FIGURES[self.figure][0]

    @property
    def higher(self) -> bool:
        """Return whether a higher figure is better."""
        return FIGURES[self.figure][2]

    @property
    def required(self) -> str:
        """Return the mark in words."""
        return f"{'at least' if self.higher else 'at most'} {self.text(self.value)}"

    def passes(self, reached: float | None) -> bool:
        """Return whether a figure reaches the mark; an unknown figure does not."""
        if reached is None:
            return False
        return reached >= self.value if self.higher else reached <= self.value

    def text(self, value: float | None) -> str:
        """Return a value of the figure as text."""
        if value is None:
            return "unknown"
        if math.isinf(value):
            return "no intervention"
        return FIGURES[self.figure][1].format(value).replace(".0%", "%")


class Reached(NamedTuple):
    """A mark, the figure that an entry reached, and whether it passed.

    `reached` is None for an unknown figure, and infinite for the metres per intervention of drives
    without an intervention.
    """

    mark: Mark
    reached: float | None
    passed: bool


def read_marks(content: object, groups: Sequence[str], place: Path | str) -> list[Mark]:
    """Return the marks of a suite's file.

    Args:
        content: value of the key `marks`.
        groups: names of the suite's groups.
        place: file that error messages name.

    Raises:
        InputError: a group, figure or value is wrong.
    """
    if not isinstance(content, Mapping) or not content:
        raise InputError(
            f"{place}: marks: must be groups with figures: {{like: {{autonomy: 0.9}}}}"
        )
    known = [*groups, HEADLINE]
    marks = []
    for group, figures in content.items():
        if group not in known:
            raise InputError(f"{place}: marks.{group}: no such group; {hint(str(group), known)}")
        usable = list(FIGURES) if group != HEADLINE else ["autonomy"]
        if not isinstance(figures, Mapping) or not figures:
            raise InputError(f"{place}: marks.{group}: must be figures: {{autonomy: 0.9}}")
        for figure, value in figures.items():
            if figure not in usable:
                raise InputError(
                    f"{place}: marks.{group}.{figure}: no such figure; {hint(str(figure), usable)}"
                )
            most = 1.0 if figure in SHARES else 1e9
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or not 0 <= value <= most:
                kind = "share in 0..1, such as 0.9" if figure in SHARES else "number of 0 or more"
                raise InputError(f"{place}: marks.{group}.{figure}: {value}; must be a {kind}")
            marks.append(Mark(str(group), str(figure), float(value)))
    return marks


def reached_marks(result: Mapping[str, Any], marks: Sequence[Mark]) -> list[Reached]:
    """Return what an entry reached for each mark.

    The figure itself is compared with the mark, not a bound of its interval.

    Args:
        result: contents of `result.json`.
        marks: marks of the same suite.
    """
    found = []
    for mark in marks:
        figure = _figure(result, mark)
        reached = figure["value"]
        # Drives without an intervention have a lower bound only.
        if reached is None and mark.figure == "m_per_intervention" and figure["low"] is not None:
            reached = math.inf
        found.append(Reached(mark, reached, mark.passes(reached)))
    return found


def missed_line(reached: Sequence[Reached]) -> str:
    """Return one line that names the missed marks; empty if all are reached."""
    missed = [one for one in reached if not one.passed]
    if not missed:
        return ""
    texts = [
        f"{one.mark.group}: {one.mark.heading} is {one.mark.text(one.reached)}, must be "
        f"{one.mark.required}"
        for one in missed
    ]
    return f"{len(missed)} of {len(reached)} marks missed: {'; '.join(texts)}"


def mark_rows(result: Mapping[str, Any], reached: Sequence[Reached]) -> list[list[str]]:
    """Return group, figure, mark, figure, 95 % interval, and passed or missed, as texts."""
    return [
        [
            "whole suite" if mark.group == HEADLINE else mark.group,
            mark.heading,
            mark.required,
            mark.text(value),
            _interval(mark, _figure(result, mark)),
            "passed" if is_passed else "missed",
        ]
        for mark, value, is_passed in reached
    ]


def _figure(result: Mapping[str, Any], mark: Mark) -> Mapping[str, Any]:
    if mark.group == HEADLINE:
        return result["headline"]
    return result["groups"][mark.group][mark.figure]


def _interval(mark: Mark, figure: Mapping[str, Any]) -> str:
    low, high = figure["low"], figure["high"]
    if low is None:
        return ""
    return f"{mark.text(low)} or more" if high is None else f"{mark.text(low)} to {mark.text(high)}"
