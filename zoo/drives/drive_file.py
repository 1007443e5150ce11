"""`drive.json`: the figures of a drive, of one format wherever the drive took place.

Beside the metrics of `zoo.drives.metrics`, a drive on a socket has its counts of telemetry and of
interventions by kind, and percentiles of its latency.
"""

from pathlib import Path
from typing import Any

from pydantic import create_model

from zoo.drives.drive_record import EMBEDDED, REPLAY, SOCKET
from zoo.drives.metrics import METRICS
from zoo.runs.bounded_files import read_json
from zoo.runs.record_fields import Fields, Number, Whole, check_fields, plain


class Known(Fields):
    """What is known of a drive beside its metrics."""

    version: Whole | None = None
    drive: str | None = None
    track: str | None = None
    seed: Whole | None = None
    nan_frames: Whole | None = None
    checkpoint: str | None = None
    set_mph: Number | None = None
    latency_percentiles_ms: dict[str, Number | None] | None = None


_figures: dict[str, Any] = {
    name: ((Whole if one.whole else Number) | None, None) for name, one in METRICS.items()
}
Summary = create_model("Summary", __base__=Known, **_figures)


def read_summary_file(path: Path) -> dict:
    """Return a drive's figures as plain containers of this version's keys; raises InputError."""
    found = read_json(path)
    return plain(check_fields(Summary, _upgraded(found), path))


def _upgraded(found: object) -> object:
    """Return what this version would have written in place of a file without a version."""
    if not isinstance(found, dict) or "version" in found:
        return found
    sources = {"telemetry": SOCKET, "recording": REPLAY, "track": EMBEDDED}
    source = next((one for key, one in sources.items() if key in found), None)
    found = {"drive": source, **found} if source else dict(found)
    if isinstance(found.get("latency_ms"), dict):
        found["latency_percentiles_ms"] = found["latency_ms"]
        found["latency_ms"] = found["latency_ms"].get("p50")
    return found
