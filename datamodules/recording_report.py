"""Figures of a recording, printed when it is loaded."""

from dataclasses import dataclass

import numpy as np

from datamodules.recording import GAP_S, Recording

KEYBOARD_SHARE = 0.4  # share of steering exactly 0 above which it usually is a keyboard's


@dataclass(frozen=True)
class RecordingReport:
    """The figures of a recording, see `report_recording`."""

    name: str
    rows: int
    side_cameras: int
    seconds: float
    fps: float
    gaps: int
    zero_share: float
    mean_speed_mph: float


def report_recordings(recording: Recording) -> list[RecordingReport]:
    """Return a report on each recording; times between recordings are not gaps."""
    return [
        report_recording(recording, recording.recording == number, name)
        for number, name in enumerate(recording.names)
    ]


def report_recording(recording: Recording, mask: np.ndarray, name: str) -> RecordingReport:
    """Return the figures of the rows in `mask`, bool [N].

    `seconds` is the driven time, without gaps; `gaps` counts times over a second between rows;
    `fps` is one over the median time between rows. Without times in the file names `seconds` and
    `fps` are NaN. `side_cameras` counts rows with both side images. `zero_share` is the share of
    rows whose steering is exactly 0: a keyboard gives many.
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
    """Return the reports as lines, one per recording, and a line for skipped rows."""
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
    return lines + skipped_lines(recording)


def skipped_lines(recording: Recording) -> list[str]:
    """Return a line for skipped rows, and one for rows with a skipped image."""
    kinds = {"bad rows": recording.bad_rows, "rows with a bad image": recording.bad_images}
    return [
        f"skipped {len(skipped):,} {kind}, the first: {skipped[0]}"
        for kind, skipped in kinds.items()
        if skipped
    ]
