"""`drive.json`: the figures of a drive, in the same format for every source of drives.

The file holds the metrics of `zoo.drives.metrics`. A drive on a socket adds counts of telemetry,
counts of interventions by kind, and percentiles of latency.
"""

from pathlib import Path
from typing import Any

from pydantic import create_model

from zoo.base.bounded_files import read_json
from zoo.drives.drive_record import EMBEDDED, REPLAY, SOCKET
from zoo.drives.metrics import METRICS
from zoo.runs.record_fields import Fields, Number, Whole, check_fields, plain


class Known(Fields):
    """Keys of `drive.json` that are not metrics."""

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
    """Return the content of a `drive.json` in the keys of this version.

    Raises:
        InputError: the file cannot be read, or a value has the wrong type.
    """
    found = plain(check_fields(Summary, _upgraded(read_json(path)), path))
    if found.get("driven_m") == 0 and not found.get("interventions"):
        found["autonomy"] = None  # earlier versions wrote 1 where the car did not move
    return found


def _upgraded(found: object) -> object:
    """Return the content of a file without a version in the keys of this version."""
    if not isinstance(found, dict) or "version" in found:
        return found
    sources = {"telemetry": SOCKET, "recording": REPLAY, "track": EMBEDDED}
    source = next((one for key, one in sources.items() if key in found), None)
    found = {"drive": source, **found} if source else dict(found)
    if isinstance(found.get("latency_ms"), dict):
        found["latency_percentiles_ms"] = found["latency_ms"]
        found["latency_ms"] = found["latency_ms"].get("p50")
    return found
