"""The metrics of a drive, a decorated function each.

Add one here, and it stands in `drive.json`, `metrics.json`, the tables of drives and
`docs/metrics.md`. Rows whose value is not known, such as those that a person drove on the socket,
are left out.
"""

import math
from collections.abc import Iterator

import numpy as np

from zoo.drives import tally
from zoo.drives.drive_record import PERSON, POLICY, SOCKET, Drive
from zoo.drives.interventions import STALLED_BELOW_MPH
from zoo.drives.metric_registry import (
    COUNT,
    DRIVES,
    HIGHER,
    LOWER,
    METRICS,
    NEITHER,
    REPLAYS,
    SHARE,
    leaderboard_metrics,
    measure,
    metric,
)
from zoo.drives.tally import LONGEST_STEP_S

# Imported from here, the registry holds the metrics below.
__all__ = ["DRIVES", "METRICS", "REPLAYS", "leaderboard_metrics", "measure"]

NVIDIA = "Bojarski et al. 2016, End to End Learning for Self-Driving Cars"
OURS = "drivezoo"
MPS_PER_MPH = 0.44704


@metric("autonomy", SHARE, HIGHER, f"{NVIDIA}, section 6", column=1)
def autonomy(drive: Drive) -> float:
    """1 - 6 s x interventions / time driven, never below 0.

    Not known where a client sends no cross-track error and no person took over.
    """
    judged = np.isfinite(drive.cross_track_m[drive.driver == POLICY]).all()
    if not judged and not drive.intervention[drive.driver == PERSON].any():
        return math.nan
    return tally.autonomy(interventions(drive), driven_s(drive))


@metric("interventions", COUNT, LOWER, f"{NVIDIA}, section 6", decimals=1, column=3)
def interventions(drive: Drive) -> int:
    """Number of times that the car left the lane, was held by a wall, or was below 1 mph for 5 s.

    The car is put back on the centre. On a socket, a person who takes over counts, too.
    """
    return int(drive.intervention.sum())


@metric(
    "metres per intervention",
    "m",
    HIGHER,
    OURS,
    decimals=0,
    heading="metres per intervention",
    without="no intervention",
    pool=lambda drives: (
        sum(one["driven_m"] for one in drives) / sum(one["interventions"] for one in drives)
    ),
)
def m_per_intervention(drive: Drive) -> float:
    """Distance driven by the interventions; of several drives, of all by those of all.

    Infinite without an intervention.
    """
    count = interventions(drive)
    return driven_m(drive) / count if count else math.inf


@metric("distance driven", "m", NEITHER, OURS, tables=())
def driven_m(drive: Drive) -> float:
    """Progress along the track; where that is not known, the sum of speed x time."""
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
    """Time from the first row to the last, of each client; on a socket, less pauses over 1 s."""
    total = 0.0
    for (time_s,) in _by_client(drive, drive.time_s):
        steps = np.diff(time_s)
        total += float(time_s[-1] - time_s[0] - (steps - _driven_steps(drive, time_s)).sum())
    return total


@metric("laps", COUNT, NEITHER, OURS, tables=(DRIVES,))
def laps(drive: Drive) -> float:
    """Distance driven by the length of a lap; not known in a replay and on a socket."""
    return driven_m(drive) / drive.length_m


@metric("lap time", "s", NEITHER, OURS, decimals=1, tables=(DRIVES,), without="no whole lap")
def lap_s(drive: Drive) -> float:
    """Mean simulated time of the whole laps."""
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
    """Mean distance from the centreline; in a replay, from the recorded path."""
    return _mean(np.abs(_known(drive.cross_track_m)))


@metric("cross-track error, RMS", "m", LOWER, OURS, replay_heading="off the recorded path, RMS, m")
def cte_rms_m(drive: Drive) -> float:
    """Root of the mean squared distance from the centreline, or from the recorded path."""
    return math.sqrt(_mean(_known(drive.cross_track_m) ** 2))


@metric("cross-track error, max", "m", LOWER, OURS, replay_heading="off the recorded path, max, m")
def cte_max_m(drive: Drive) -> float:
    """Greatest distance from the centreline, or from the recorded path."""
    known = _known(drive.cross_track_m)
    return float(np.abs(known).max()) if len(known) else math.nan


@metric("time beyond 1 m", SHARE, LOWER, OURS, tables=(DRIVES,))
def beyond_1m(drive: Drive) -> float:
    """Share of the rows that are more than 1 m from the centreline."""
    return _mean(np.abs(_known(drive.cross_track_m)) > 1)


@metric("steering change", "1/s", LOWER, OURS)
def steering_per_s(drive: Drive) -> float:
    """Change of the steering (-1..1), up and down added, by the time driven: the smoothness."""
    seconds = driven_s(drive)
    change = sum(
        float(np.abs(np.diff(steering[driver != PERSON])).sum())
        for steering, driver in _by_client(drive, drive.steering, drive.driver)
    )
    return change / seconds if seconds else math.nan


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
    """Steering change of the expert on the same track, or of a replay's recorded driver."""
    known = math.isfinite(drive.expert_steering_per_s)
    return drive.expert_steering_per_s if known else None


@metric("speed", "mph", NEITHER, OURS, decimals=1, tables=(DRIVES,))
def speed_mph(drive: Drive) -> float:
    """Mean speed of the rows."""
    return _mean(_known(drive.speed_mph))


@metric("time stalled", SHARE, LOWER, OURS, tables=(DRIVES,))
def stalled(drive: Drive) -> float:
    """Share of the rows below 1 mph."""
    return _mean(_known(drive.speed_mph) < STALLED_BELOW_MPH)


@metric("latency, median", "ms", LOWER, OURS, decimals=1)
def latency_ms(drive: Drive) -> float:
    """Median wall time from a frame's arrival to its reply: the policy, and the reply's way."""
    known = _known(drive.latency_ms)
    return float(np.median(known)) if len(known) else math.nan


def _by_client(drive: Drive, *columns: np.ndarray) -> Iterator[list[np.ndarray]]:
    """Yield the columns of each simulator that took part."""
    for client in np.unique(drive.client):
        yield [column[drive.client == client] for column in columns]


def _driven_steps(drive: Drive, time_s: np.ndarray) -> np.ndarray:
    """Return the seconds from each row to the next, 0 for a pause on the socket."""
    steps: np.ndarray = np.diff(time_s)
    if drive.source == SOCKET:
        steps[steps > LONGEST_STEP_S] = 0.0
    return steps


def _known(column: np.ndarray) -> np.ndarray:
    known: np.ndarray = column[np.isfinite(column)]
    return known


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan
