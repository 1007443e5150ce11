"""The registry of a drive's metrics: one decorated function each, see `zoo.drives.metrics`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from zoo.drives.drive_record import Drive

HIGHER, LOWER, NEITHER = "higher is better", "lower is better", "neither"
SHARE, COUNT = "share", "count"  # units that no heading repeats
DRIVES, REPLAYS = "drives", "replays"  # the tables of drives on a track, and of a replay

Function = Callable[[Drive], float | None]
Registered = TypeVar("Registered", bound=Function)
Pool = Callable[[list[dict]], float]


@dataclass(frozen=True)
class Metric:
    """A figure of a drive: how it is computed, and how tables, files and pages name it.

    Attributes:
        name: key in `drive.json` and `metrics.json`, the function's own name.
        function: returns the figure of a drive; NaN where it is not known, and None where it does
            not apply, which leaves it out of the drive's figures.
        label: name in words.
        unit: of the figure; SHARE is 0..1 and shown in percent.
        direction: HIGHER, LOWER or NEITHER.
        source: publication or file that defines the metric.
        decimals: digits after the point in tables.
        tables: those of DRIVES and REPLAYS that show it.
        heading: words in tables, where label and unit do not do.
        replay_heading: words in a replay's table, where others are meant there.
        without: words in tables where no drive has the figure.
        pool: returns the figure of several drives, where that is not the mean of theirs.
        column: place among the leaderboard's columns; None leaves it out.
        column_label: name in the leaderboard, where the label is too long.
    """

    name: str
    function: Function
    label: str
    unit: str
    direction: str
    source: str
    decimals: int = 2
    tables: tuple[str, ...] = (DRIVES, REPLAYS)
    heading: str = ""
    replay_heading: str = ""
    without: str = "-"
    pool: Pool | None = None
    column: int | None = None
    column_label: str = ""

    @property
    def form(self) -> str:
        """The format of a value, for `str.format`."""
        return "{:.1%}" if self.unit == SHARE else f"{{:.{self.decimals}f}}"

    @property
    def whole(self) -> bool:
        """Whether the figure of a drive is a whole number: its function is annotated `-> int`."""
        return self.function.__annotations__.get("return") is int

    def row(self, table: str) -> tuple[str, str]:
        """Return heading and format in a table, DRIVES or REPLAYS."""
        named = self.label if self.unit in (SHARE, COUNT) else f"{self.label}, {self.unit}"
        if table == DRIVES:
            return self.heading or named, self.form
        # A replay is one drive: what is counted is whole.
        form = "{:.0f}" if self.unit == COUNT else self.form
        return self.replay_heading or self.heading or named, form

    def column_heading(self, track: str) -> str:
        """Return the heading of a track's column in the leaderboard."""
        unit = "" if self.unit in (SHARE, COUNT) else f" ({self.unit})"
        return f"{self.column_label or self.label}, {track}{unit}"


METRICS: dict[str, Metric] = {}  # by name, in the order of tables and files


def metric(
    label: str, unit: str, direction: str, source: str, **more: Any
) -> Callable[[Registered], Registered]:
    """Register the decorated function as a metric; its docstring is the definition.

    Args:
        label, unit, direction, source: as in `Metric`.
        **more: further attributes of `Metric`.

    Raises:
        ValueError: a metric of that name exists, or the function has no docstring.
    """

    def register(function: Registered) -> Registered:
        name = function.__name__
        if name in METRICS:
            raise ValueError(f"metric {name}: is registered already; name the function otherwise")
        if not function.__doc__:
            raise ValueError(f"metric {name}: needs a docstring, which is its definition")
        METRICS[name] = Metric(name, function, label, unit, direction, source, **more)
        return function

    return register


def measure(drive: Drive) -> dict[str, float]:
    """Return every metric of a drive by name; all but `latency_ms` are the same for a same seed."""
    figures = {name: one.function(drive) for name, one in METRICS.items()}
    return {name: value for name, value in figures.items() if value is not None}


def leaderboard_metrics() -> list[Metric]:
    """Return the metrics that the leaderboard shows, in its order."""
    shown = [one for one in METRICS.values() if one.column is not None]
    return sorted(shown, key=lambda one: one.column or 0)
