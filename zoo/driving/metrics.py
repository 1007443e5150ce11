"""The metrics of a drive: one decorated function each, whose docstring is the definition.

A metric that is added here appears in `drive.json`, `metrics.json`, the tables of drives and
`docs/metrics.md`. That page defines the symbols of the formulas: the time `t[i]`, cross-track error
`e[i]`, steering `s[i]`, its spread `d[i]` and speed `v[i]` of row i. Rows without a value are left
out.
"""

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from inspect import getdoc
from operator import index
from typing import Any, TypeVar

import numpy as np

from zoo.base.parts import part_failure
from zoo.base.registry import Registry
from zoo.base.rig import MPS_PER_MPH
from zoo.driving import tally
from zoo.driving.drive_record import BAND, PERSON, POLICY, REPLAY, SOCKET, Drive
from zoo.driving.interventions import STALLED_BELOW_MPH

HIGHER, LOWER, NEITHER = "higher is better", "lower is better", "neither"
SHARE, COUNT, NUMBER = "share", "count", "1"
WITHOUT_UNIT = SHARE, COUNT, NUMBER  # units that headings of tables leave out
DRIVES, REPLAYS = "drives", "replays"  # tables: drives on a track, and a replay

Function = Callable[[Drive], float | None]
Registered = TypeVar("Registered", bound=Function)


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
    pool: Callable[[list[dict]], float] | None = None
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
_FAILED: set[Function] = set()  # users' functions whose failure was printed


def metric(
    label: str, unit: str, direction: str, source: str, **options: Any
) -> Callable[[Registered], Registered]:
    """Register the decorated function as a metric; its docstring is the metric's definition.

    Args:
        label: see `Metric`.
        unit: see `Metric`.
        direction: see `Metric`.
        source: see `Metric`.
        **options: further attributes of `Metric`.

    Raises:
        ValueError: another module has a metric of that name, or the function has no docstring.
    """

    def register(function: Registered) -> Registered:
        name = function.__name__
        if not function.__doc__:
            raise ValueError(f"metric {name}: has no docstring; write its definition there")
        entry = Metric(name, function, label, unit, direction, source, **options)
        METRICS.add(name, entry, function.__module__)
        return function

    return register


def measure(drive: Drive) -> dict[str, float]:
    """Return the metrics of a drive by name; the same seed gives the same, but for `latency_ms`.

    Those of a drive's `drive.json` are returned as they stand there: its rows are rounded, and do
    not tell the progress along the track.
    """
    known = {name: value for name, value in drive.summary.items() if value is not None}
    figures = {name: known.get(name, _figure(each, drive)) for name, each in METRICS.items()}
    return {key: value for key, value in figures.items() if value is not None}


def _figure(metric: Metric, drive: Drive) -> float | None:
    """Return a metric of a drive; NaN, and once a line, if a part's function fails."""
    try:
        value: Any = metric.function(drive)
        # A user's function may return a number of NumPy, which JSON has not.
        return value if value is None else (index if metric.whole else float)(value)
    except Exception as error:  # a user's function may raise any
        if metric.name in METRICS.own():
            raise
        kind = f"{metric.function.__module__}: {type(error).__name__}"
        reason = part_failure(error) or f"{kind}: {error}; return a number"
        if metric.function not in _FAILED:  # a line for each drive tells no more
            print(f"metric {metric.name} is unknown: {reason}", file=sys.stderr)
        _FAILED.add(metric.function)
        return math.nan


def leaderboard_metrics() -> list[Metric]:
    """Return the metrics that the leaderboard shows, in the order of its columns."""
    shown = [metric for metric in METRICS.values() if metric.column is not None]
    return sorted(shown, key=lambda metric: metric.column or 0)


NVIDIA = "Bojarski et al. 2016, End to End Learning for Self-Driving Cars, arXiv:1604.07316"
OURS = "drivezoo"


@metric("autonomy", SHARE, HIGHER, f"{NVIDIA}, section 7.1", without="not measured", column=1)
def autonomy(drive: Drive) -> float:
    """Share of the time that the car drove by itself, with 6 s counted for each intervention.

    Formula: `max(0, 1 - 6 * interventions / driven_s)`.

    The rule of interventions is that of `interventions` below. Unknown in a Gymnasium
    environment without a cross-track error; on a socket if the simulator sends none and no person
    took over; and where the car did not move and no intervention was counted.
    """
    if driven_m(drive) == 0 and not interventions(drive):
        return math.nan
    judged = np.isfinite(drive.cross_track_m[drive.driver == POLICY]).all()
    if not judged and not drive.intervention[drive.driver == PERSON].any():
        return math.nan
    return tally.autonomy(interventions(drive), driven_s(drive))


@metric("interventions", COUNT, LOWER, f"{NVIDIA}, section 7.1", decimals=1, column=3)
def interventions(drive: Drive) -> int:
    """Count of the times that the car left the lane, was held by a wall, or stood still.

    Left the lane: `|e[i]|` exceeds half the width of the road (in a replay: 1 m, or the height of a
    camera that is lower), or the `margin` that the user sets. Stood still: `v[i]` stays below 1 mph
    for more than 5 s. On a socket, each takeover by a person counts, too.

    After each intervention the car is put back on the centre. A simulator on a socket that cannot
    put it back costs another intervention for every further 6 s off the road, or 5 s of standing
    still.
    """
    return int(drive.intervention.sum())


@metric(
    "metres per intervention",
    "m",
    HIGHER,
    OURS,
    bounds="any; infinite without an intervention",
    decimals=0,
    heading="metres per intervention",
    without="no intervention",
    pool=lambda drives: (
        sum(drive["driven_m"] for drive in drives) / sum(drive["interventions"] for drive in drives)
    ),
)
def m_per_intervention(drive: Drive) -> float:
    """Distance driven per intervention.

    Formula: `driven_m / interventions`. For several drives: the sum of `driven_m` divided by the
    sum of `interventions`.
    """
    count = interventions(drive)
    return driven_m(drive) / count if count else math.inf


@metric("distance driven", "m", NEITHER, OURS, bounds="any", tables=())
def driven_m(drive: Drive) -> float:
    """Progress along the centreline of the track; negative if the car ends behind its start.

    In a replay: the distance that the recorded car drove. On a socket: the sum of
    `v[i] * (t[i+1] - t[i])` without pauses, in metres.
    """
    if math.isfinite(drive.driven_m):
        return drive.driven_m
    return sum(
        float(np.nansum(mph[:-1] * _driven_steps(drive, time_s)) * MPS_PER_MPH)
        for time_s, mph in _by_client(drive, drive.time_s, drive.speed_mph)
    )


@metric(
    "time driven",
    "s",
    NEITHER,
    OURS,
    decimals=1,
    tables=(REPLAYS,),
    replay_heading="time replayed, s",
)
def driven_s(drive: Drive) -> float:
    """Time from the first row to the last, summed over the simulators that took part.

    Simulated time in the embedded world, recorded time in a replay. On a socket: the simulator's
    time if it sends one, else wall time; steps of more than 1 s are pauses and count as 0.
    """
    return sum(
        float(time_s[-1] - time_s[0] - (np.diff(time_s) - _driven_steps(drive, time_s)).sum())
        for (time_s,) in _by_client(drive, drive.time_s)
    )


@metric("laps", COUNT, NEITHER, OURS, bounds="any", tables=(DRIVES,))
def laps(drive: Drive) -> float:
    """Distance driven in laps, with decimals.

    Formula: `driven_m` divided by the length of the track's centreline. The number of whole laps in
    a world that counts them and has no length, such as a Donkeycar simulator. Unknown in a replay
    and on a socket.
    """
    if math.isnan(drive.length_m) and len(drive.lap_s):
        return len(drive.lap_s)
    return driven_m(drive) / drive.length_m


@metric("lap time", "s", NEITHER, OURS, decimals=1, tables=(DRIVES,), without="no whole lap")
def lap_s(drive: Drive) -> float:
    """Mean simulated time of the completed laps; unknown without one."""
    return float(np.mean(drive.lap_s)) if len(drive.lap_s) else math.nan


@metric(
    "cross-track error, mean",
    "m",
    LOWER,
    OURS,
    replay_heading="off the recorded path, mean, m",
    column=2,
    column_label="error",
)
def cte_mean_m(drive: Drive) -> float:
    """Mean of `|e[i]|` over the rows.

    In a replay, `e[i]` is the distance from the recorded path instead of the centreline.
    """
    return _mean(np.abs(_known(drive.cross_track_m)))


@metric("cross-track error, RMS", "m", LOWER, OURS, replay_heading="off the recorded path, RMS, m")
def cte_rms_m(drive: Drive) -> float:
    """Square root of the mean of `e[i]^2` over the rows; `e[i]` as in `cte_mean_m`."""
    return math.sqrt(_mean(_known(drive.cross_track_m) ** 2))


@metric("cross-track error, max", "m", LOWER, OURS, replay_heading="off the recorded path, max, m")
def cte_max_m(drive: Drive) -> float:
    """Greatest `|e[i]|` of the rows; `e[i]` as in `cte_mean_m`."""
    errors = _known(drive.cross_track_m)
    return float(np.abs(errors).max()) if len(errors) else math.nan


@metric("time beyond 1 m", SHARE, LOWER, OURS, tables=(DRIVES,))
def beyond_1m(drive: Drive) -> float:
    """Share of the rows with `|e[i]| > 1 m`; `e[i]` as in `cte_mean_m`."""
    return _mean(np.abs(_known(drive.cross_track_m)) > 1)


@metric("return per episode", NUMBER, HIGHER, "Gymnasium", bounds="any", decimals=1)
def episode_return(drive: Drive) -> float | None:
    """Sum of the rewards of a Gymnasium environment, per episode.

    Each intervention begins another episode. Other worlds have no reward.
    """
    return None if math.isnan(drive.episode_return) else drive.episode_return


@metric("steering change", "1/s", LOWER, OURS)
def steering_per_s(drive: Drive) -> float:
    """Absolute change of the steering per second; a smooth drive has a small one.

    Formula: `sum(|s[i+1] - s[i]|) / driven_s`, both without steps from or to a person. A steering
    of 1 is 25 degrees at the front wheels.
    """
    change, seconds = 0.0, driven_s(drive)
    for time_s, steering, driver in _by_client(drive, drive.time_s, drive.steering, drive.driver):
        by_policy = (driver[1:] != PERSON) & (driver[:-1] != PERSON)
        change += float(np.abs(np.diff(steering))[by_policy].sum())
        seconds -= float(_driven_steps(drive, time_s)[~by_policy].sum())
    return change / seconds if seconds > 1e-9 else math.nan


@metric(
    "steering change of the expert",
    "1/s",
    NEITHER,
    OURS,
    heading="  the expert's",
    replay_heading="  the recorded driver's",
    pool=lambda drives: drives[0]["expert_steering_per_s"],
)
def expert_steering_per_s(drive: Drive) -> float | None:
    """Steering change of a reference driver, by the formula of `steering_per_s`.

    On a track: the expert's, on a lap with the same keys but for start seed 0 and clear weather, in
    `metrics.json` alone. In a replay: that of the recorded driver.
    """
    return drive.expert_steering_per_s if math.isfinite(drive.expert_steering_per_s) else None


@metric("speed", "mph", NEITHER, OURS, decimals=1, tables=(DRIVES,))
def speed_mph(drive: Drive) -> float:
    """Mean of `v[i]` over the rows."""
    return _mean(_known(drive.speed_mph))


@metric("time stalled", SHARE, LOWER, OURS, tables=(DRIVES,))
def stalled(drive: Drive) -> float:
    """Share of the rows with `v[i] < 1 mph`."""
    return _mean(_known(drive.speed_mph) < STALLED_BELOW_MPH)


@metric("latency, median", "ms", LOWER, OURS, decimals=1)
def latency_ms(drive: Drive) -> float:
    """Median wall time that a frame takes.

    On a socket: from the arrival of the telemetry to the sending of the reply. In the embedded
    world and in a replay: the call of the policy alone. It depends on the machine.
    """
    latencies = _known(drive.latency_ms)
    return float(np.median(latencies)) if len(latencies) else math.nan


@metric("spread of the steering, mean", NUMBER, NEITHER, OURS, decimals=3)
def spread_mean(drive: Drive) -> float | None:
    """Mean of the standard deviation `d[i]` that the policy predicts for its steering.

    Left out of a drive whose policy predicts none.
    """
    spreads = _known(drive.spread)
    return float(spreads.mean()) if len(spreads) else None


@metric("expert within 1.96 spreads", SHARE, NEITHER, OURS, bounds="0 to 1; 0.95 is calibrated")
def spread_coverage(drive: Drive) -> float | None:
    """Share of the rows in which the expert's steering is within `s[i] +- 1.96 d[i]`.

    The expert steers at the same place, in the embedded world. `d[i]` is the standard deviation
    that the policy predicts; that of a normal distribution covers 95 %. A smaller share shows a
    policy that is too sure. Left out of a drive without spread or expert, and of a replay, whose
    recorded driver was at another place.
    """
    if drive.source == REPLAY:
        return None
    gap = np.abs(drive.expert_steering - drive.steering)
    finite = np.isfinite(gap) & np.isfinite(drive.spread)
    return _mean(gap[finite] <= BAND * drive.spread[finite]) if finite.any() else None


@metric("rank correlation, spread and error", NUMBER, HIGHER, OURS, bounds="-1 to 1")
def spread_rank_cte(drive: Drive) -> float | None:
    """Spearman's rank correlation of the spread `d[i]` and `|e[i]|`.

    Above 0, the policy doubts more where the car is farther from the centreline. Unknown if the
    spread is constant. Left out of a drive without spread.
    """
    finite = np.isfinite(drive.spread) & np.isfinite(drive.cross_track_m)
    if not finite.any():
        return None
    columns = drive.spread[finite], np.abs(drive.cross_track_m[finite])
    if min(map(np.ptp, columns)) == 0:
        return math.nan
    from scipy.stats import spearmanr  # slow import

    return float(spearmanr(*columns).statistic)


def _by_client(drive: Drive, *columns: np.ndarray) -> Iterator[list[np.ndarray]]:
    """Yield the columns of each simulator in turn."""
    for client in np.unique(drive.client):
        yield [column[drive.client == client] for column in columns]


def _driven_steps(drive: Drive, time_s: np.ndarray) -> np.ndarray:
    """Return the seconds from each row to the next; 0 for a pause on a socket."""
    steps: np.ndarray = np.diff(time_s)
    if drive.source == SOCKET:
        steps[steps > tally.LONGEST_STEP_S] = 0.0
    return steps


def _known(column: np.ndarray) -> np.ndarray:
    return np.compress(np.isfinite(column), column)


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan


_PAGE = """# The metrics of a drive

Written by `drivezoo results --metrics > docs/metrics.md` from the functions of
[zoo/driving/metrics.py](../zoo/driving/metrics.py).

A drive is a sequence of rows, one for each time step *i*. A row holds the time `t[i]` in seconds,
the cross-track error `e[i]` in metres (from the centreline, positive is right), the steering
`s[i]` from -1 to 1, its spread `d[i]` (a standard deviation, if the policy predicts one), the
speed `v[i]` in mph, and whether an intervention begins. In the embedded world a row is 1/15 s of
simulated time by default (`frame_rate=15`); on a socket it is one telemetry message.

`drive.json` has a drive's metrics. `metrics.json` has their mean and sample standard deviation
(n - 1) over the drives of a track. Means over rows leave out rows without a value. A metric that is
unknown, or infinite, is `null`. A *share* is shown in percent in tables.
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
