"""`drive.json`: the figures of a drive."""

from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator

from zoo.runs.bounded_files import read_json
from zoo.runs.record_fields import Fields, Number, Whole, check_fields, finite, plain


def _latency(value: object) -> object:
    for one in value.values() if isinstance(value, dict) else [value]:
        if isinstance(one, bool) or not isinstance(one, int | float | None):
            raise ValueError("should be a number, or numbers by percentile")
        finite(one)
    return value


Latency = Annotated[object, BeforeValidator(_latency)]  # of a scored drive, or of one on a socket


class Summary(Fields):
    """What `zoo.drives.drive_log.write_summary` wrote, of a drive on a socket or a scored one."""

    track: str | None = None
    seed: Whole | None = None
    nan_frames: Whole | None = None
    autonomy: Number | None = None
    interventions: Whole | None = None
    m_per_intervention: Number | None = None
    driven_m: Number | None = None
    driven_s: Number | None = None
    laps: Number | None = None
    lap_s: Number | None = None
    cte_mean_m: Number | None = None
    cte_rms_m: Number | None = None
    cte_max_m: Number | None = None
    beyond_1m: Number | None = None
    steering_per_s: Number | None = None
    expert_steering_per_s: Number | None = None
    speed_mph: Number | None = None
    stalled: Number | None = None
    latency_ms: Latency | None = None


def read_summary_file(path: Path) -> dict:
    """Return a drive's figures as plain containers; raises InputError."""
    return plain(check_fields(Summary, read_json(path), path))
