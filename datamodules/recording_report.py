"""What a recording holds, in figures: printed whenever one is loaded."""

from dataclasses import dataclass

import numpy as np

from datamodules.recording import GAP_S, Recording

KEYBOARD_SHARE = 0.4  # of steering exactly 0; above it, as a rule, a keyboard's


@dataclass(frozen=True)
class RecordingReport:
    """Figures of one recording (or of all): see `report_recording`."""

    name: str
    rows: int
    side_cameras: int
    seconds: float
    fps: float
    gaps: int
    zero_share: float
    mean_speed_mph: float


def report_recordings(recording: Recording) -> list[RecordingReport]:
    """Return a report on each recording; pauses between recordings are not gaps."""
    return [
        report_recording(recording, recording.recording == number, name)
        for number, name in enumerate(recording.names)
    ]


def report_recording(recording: Recording, mask: np.ndarray, name: str) -> RecordingReport:
    """Figures of the rows in `mask` (bool [N]).

    `seconds` counts the time between neighbouring rows without the pauses longer than a second,
    which are `gaps`; `fps` is one over the median step; both are NaN where the file names carry no
    time. `side_cameras` is the number of rows with both. `zero_share` is the share of rows whose
    steering is exactly 0, which is what a keyboard leaves.
    """
    steps = np.diff(recording.time_s[mask])
    driven = steps[(steps > 0) & (steps <= GAP_S)]
    images = recording.images[mask]
    return RecordingReport(
        name=name,
        rows=int(mask.sum()),
        side_cameras=sum(None not in row for row in images[:, 1:].tolist()),
        seconds=float(driven.sum()) if len(driven) else float("nan"),
        fps=float(1 / np.median(driven)) if len(driven) else float("nan"),
        gaps=int(((steps > GAP_S) | (steps < 0)).sum()),
        zero_share=float((recording.steering[mask] == 0).mean()) if mask.any() else float("nan"),
        mean_speed_mph=float(recording.speed_mph[mask].mean()) if mask.any() else float("nan"),
    )


def report_lines(recording: Recording) -> list[str]:
    """Return the reports as lines, one per recording, and a line for skipped images."""
    lines = []
    for report in report_recordings(recording):
        timing = "no times in the file names"
        if np.isfinite(report.seconds):
            gaps = f"{report.gaps} gap{'' if report.gaps == 1 else 's'}"
            timing = f"{report.seconds:.0f} s at {report.fps:.1f} frames/s, {gaps}"
        sides = "3 cameras"
        if report.side_cameras == 0:
            sides = "centre camera only"
        elif report.side_cameras < report.rows:
            sides = f"3 cameras in {report.side_cameras:,} rows"
        lines.append(
            f"{report.name}: {report.rows:,} rows, {sides}, {timing}, "
            f"{report.zero_share:.0%} of steering exactly 0, mean {report.mean_speed_mph:.1f} mph"
        )
    if recording.bad_images:
        count = len(recording.bad_images)
        lines.append(f"skipped {count} rows with a bad image, first: {recording.bad_images[0]}")
    return lines
