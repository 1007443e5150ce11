"""The registry of the metrics of a drive: one decorated function each, see `zoo.drives.metrics`."""

from collections.abc import Callable
from dataclasses import dataclass
from inspect import getdoc
from typing import Any, TypeVar

from zoo.cli.registry import Registry
from zoo.drives.drive_record import Drive

HIGHER, LOWER, NEITHER = "higher is better", "lower is better", "neither"
SHARE, COUNT, NUMBER = "share", "count", "1"
WITHOUT_UNIT = SHARE, COUNT, NUMBER  # units that headings of tables leave out
DRIVES, REPLAYS = "drives", "replays"  # tables: drives on a track, and a replay

Function = Callable[[Drive], float | None]
Registered = TypeVar("Registered", bound=Function)
Pool = Callable[[list[dict]], float]


@dataclass(frozen=True)
class Metric:
    """A metric of a drive: its function, and its names in tables, files and pages.

    Attributes:
        name: key in `drive.json` and `metrics.json`, which is the function's name.
        function: function that returns the value for a drive; NaN if the value is unknown, None if
            the metric does not apply, which leaves its key out.
        label: name in words.
        unit: unit of the value; SHARE is 0..1 and shown in percent.
        direction: HIGHER, LOWER or NEITHER.
        source: publication or program that defines the metric.
        bounds: range of the value in words; empty for the usual range of the unit.
        decimals: number of decimals in tables.
        tables: tables that show the metric, of DRIVES and REPLAYS.
        heading: heading in tables; empty for label and unit.
        replay_heading: heading in the table of a replay; empty for `heading`.
        without: text in tables if no drive has a value.
        pool: function that returns the value for several drives; None for their mean.
        column: position among the leaderboard's columns, 4 or more after drivezoo's; None leaves
            the metric out.
        column_label: name in the leaderboard; empty for the label.
    """

    name: str
    function: Function
    label: str
    unit: str
    direction: str
    source: str
    bounds: str = ""
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
        """Return the format of a value, for `str.format`."""
        return "{:.1%}" if self.unit == SHARE else f"{{:.{self.decimals}f}}"

    @property
    def whole(self) -> bool:
        """Whether the value of a drive is an integer: the function is annotated `-> int`."""
        return self.function.__annotations__.get("return") is int

    @property
    def range(self) -> str:
        """Return the range of the value in words."""
        usual = "0 to 1" if self.unit == SHARE else "0 or more"
        return self.bounds or (f"integer, {usual}" if self.whole else usual)

    def row(self, table: str) -> tuple[str, str]:
        """Return heading and format in a table, DRIVES or REPLAYS."""
        named = self.label if self.unit in WITHOUT_UNIT else f"{self.label}, {self.unit}"
        if table == DRIVES:
            return self.heading or named, self.form
        # A replay is one drive, so that its counts are integers.
        form = "{:.0f}" if self.unit == COUNT else self.form
        return self.replay_heading or self.heading or named, form

    def column_heading(self, track: str) -> str:
        """Return the heading of a track's column in the leaderboard."""
        unit = "" if self.unit in WITHOUT_UNIT else f" ({self.unit})"
        return f"{self.column_label or self.label}, {track}{unit}"


METRICS: Registry[Metric] = Registry("metric")  # by name, in the order of tables and files


def metric(
    label: str, unit: str, direction: str, source: str, **more: Any
) -> Callable[[Registered], Registered]:
    """Register the decorated function as a metric; its docstring is the metric's definition.

    Args:
        label: see `Metric`.
        unit: see `Metric`.
        direction: see `Metric`.
        source: see `Metric`.
        **more: further attributes of `Metric`.

    Raises:
        ValueError: another module has a metric of that name, or the function has no docstring.
    """

    def register(function: Registered) -> Registered:
        name = function.__name__
        if not function.__doc__:
            raise ValueError(f"metric {name}: has no docstring; write its definition there")
        entry = Metric(name, function, label, unit, direction, source, **more)
        METRICS.add(name, entry, function.__module__)
        return function

    return register


def measure(drive: Drive) -> dict[str, float]:
    """Return the metrics of a drive by name; the same seed gives the same, but for `latency_ms`."""
    figures = {name: metric.function(drive) for name, metric in METRICS.items()}
    return {name: value for name, value in figures.items() if value is not None}


def leaderboard_metrics() -> list[Metric]:
    """Return the metrics that the leaderboard shows, in the order of its columns."""
    shown = [metric for metric in METRICS.values() if metric.column is not None]
    return sorted(shown, key=lambda metric: metric.column or 0)


_PAGE = """# The metrics of a drive

Written by `drivezoo results --metrics > docs/metrics.md` from the functions of
[zoo/drives/metrics.py](../zoo/drives/metrics.py).

A drive is a sequence of rows, one for each time step *i*. A row holds the time `t[i]` in seconds,
the cross-track error `e[i]` in metres (the signed distance of the car from the centreline, positive
is right), the steering `s[i]` from -1 to 1, its spread `d[i]` (a standard deviation, if the policy
predicts one), the speed `v[i]` in mph, and whether an intervention begins. In the embedded world,
time is simulated time, and a row is 1/15 s by default (`frame_rate=15`). On a socket, a row is one
telemetry message.

Every drive has these metrics in its `drive.json`: in the embedded world, on a socket, and in the
replay of a recording. `metrics.json` has their mean and sample standard deviation (n - 1) over the
drives of a track. Means over rows leave out the rows without a value, such as those that a person
drove on a socket. A metric that is unknown, or infinite, is `null` in these files. A *share* is
shown in percent in tables.
"""


def metrics_page() -> str:
    """Return the page as Markdown: a table of all metrics, then a definition of each."""
    rows = [
        f"| [`{metric.name}`](#{metric.name}) | {metric.label} | {metric.unit} | {metric.range} "
        f"| {metric.direction} | {metric.source} |\n"
        for metric in METRICS.values()
    ]
    definitions = [
        f"\n## `{metric.name}`\n\n{getdoc(metric.function)}\n" for metric in METRICS.values()
    ]
    head = "\n| key | metric | unit | range | direction | source |\n|---|---|---|---|---|---|\n"
    return "".join([_PAGE, head, *rows, *definitions])
