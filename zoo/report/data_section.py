"""The section on the training data."""

import math
from dataclasses import dataclass

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.findings import report_recordings
from datamodules.recording import Recording
from datamodules.samples import make_samples
from datamodules.stretches import LEAST_CHANGE, STRETCH_S, find_stretches, steering_returns
from zoo.report.blocks import Block, Heading, Images, MissingError, Rows, Text, gather
from zoo.report.report_images import labelled_frame, read_frame, smaller
from zoo.report.reported_run import ReportedRun
from zoo.runs.table import Table

SHOWN = 6  # number of frames of the recovery


def data_blocks(run: ReportedRun) -> list[Block]:
    """Return rows, split, similarity, histogram and images, or a line for each missing part."""
    return gather((_recordings, _split, _balance, _cameras, _flipped, _recovery, _fed), run)


def _recordings(run: ReportedRun) -> list[Block]:
    recording = run.recording
    rows = []
    for one in report_recordings(recording):
        known = math.isfinite(one.seconds)
        rows.append(
            [
                one.name,
                f"{one.rows:,}",
                f"{one.side_cameras:,}",
                f"{one.seconds / 60:.1f}" if known else "-",
                f"{one.fps:.1f}" if known else "-",
                f"{one.gaps}" if known else "-",
                f"{one.zero_share:.0%}",
                f"{one.mean_speed_mph:.1f}",
            ]
        )
    headers = ["recording", "rows", "with side cameras", "minutes", "rows/s", "pauses"]
    blocks: list[Block] = [Rows(Table.of([*headers, "steering exactly 0", "mean mph"], rows))]
    trained_on = (run.metrics.get("data") or {}).get("fingerprint")
    if trained_on and trained_on != recording.fingerprint():
        blocks.append(
            Text(
                f"The recording is not the one of the training: it now has {len(recording):,} rows "
                f"with fingerprint {recording.fingerprint()}. It was changed after the training, "
                "or rows with damaged images were skipped."
            )
        )
    return blocks


def _split(run: ReportedRun) -> list[Block]:
    data, settings = run.figures("data"), run.config["data"]
    sizes = ", ".join(f"{count:,} {part}" for part, count in data["split"].items())
    left_out = data["rows"] - sum(data["split"].values())
    blocks: list[Block] = [
        Text(
            f"{data['rows']:,} rows with fingerprint {data['fingerprint']}, split by "
            f"{settings['split']}: {sizes}; {left_out:,} rows between the parts are not used. "
            "Validation and test use only the centre camera and the recorded steering, without "
            "flipping, augmentation, balancing or offset."
        )
    ]
    leaks = run.metrics.get("leak") or {}
    if leaks:
        headings = ["rows", "seconds to the nearest", "difference to the most similar"]
        rows = [
            [
                part,
                "-" if leak["seconds"] is None else f"{leak['seconds']:.2f}",
                f"{leak['likeness']:.0%}",
            ]
            for part, leak in leaks.items()
        ]
        blocks += [
            Text(
                "Similarity of held-out and training frames (medians): the time to the nearest "
                "training frame, and the difference to the most similar training frame, as a share "
                "of the difference between any two frames. Near 0 s and 0 %, held-out rows are "
                "almost copies of training rows, and their figures mean little."
            ),
            Rows(Table.of(headings, rows)),
        ]
    return blocks


def _balance(run: ReportedRun) -> list[Block]:
    data = run.config["data"]
    cap, threshold = data.get("straight_cap"), data["straight_threshold"]
    limit = "no limit on straight driving"
    if cap is not None:
        limit = f"at most {cap:.0%} of a batch has a |steering| below {threshold:g}"
    both = data["flip"] == "both"
    flipped = "each sample also flipped" if both else f"flipped with probability {data['flip']}"
    image = run.plot(
        "steering_histogram",
        f"Steering before and after balancing: {limit}; {flipped}.",
        "The run has no steering histogram (callbacks.steering_histogram).",
    )
    return [Heading("Balance"), Images([image])]


def _cameras(run: ReportedRun) -> list[Block]:
    recording, data = run.recording, run.config["data"]
    samples = _samples(run, np.arange(len(recording)))
    used = [camera for camera in CAMERAS if camera in data["cameras"]]
    count = np.bincount(samples.row, minlength=len(recording))
    rows = np.flatnonzero(count == count.max())
    # Not straight ahead, and not the sharpest bend.
    bends = rows[np.abs(recording.steering[rows]) >= data["straight_threshold"]]
    rows = bends if len(bends) else rows
    row = rows[np.argsort(np.abs(recording.steering[rows]), kind="stable")[len(rows) // 2]]
    images = []
    for camera in ("left", "center", "right"):
        sample = _samples(run, np.array([row]))
        own = np.flatnonzero(sample.camera == CAMERAS.index(camera))
        if camera not in used or not len(own):
            continue
        steering = float(sample.steering[own[0]])
        frame = read_frame(recording.images[row, CAMERAS.index(camera)])
        caption = f"{camera}: label {_signed(steering)}"
        images.append(labelled_frame(f"camera_{camera}", frame, steering, caption))
    how = f"offset by {data['offset']:g}"
    if data.get("recover_s") is not None:
        how = f"changed to return to the centreline in {data['recover_s']:g} s"
    return [
        Heading("One frame of each camera"),
        Text(
            f"{recording.place(int(row))}, chosen for its median steering. Recorded steering: "
            f"{_signed(recording.steering[row])}. Steering of the side cameras: {how}."
        ),
        Images(images, columns=3),
    ]


def _flipped(run: ReportedRun) -> list[Block]:
    recording, data = run.recording, run.config["data"]
    flip = data["flip"]
    if not flip:
        return [Text("No sample was flipped (data.flip=0).")]
    steering = np.abs(recording.steering)
    row = int(np.argsort(steering, kind="stable")[int(0.9 * (len(steering) - 1))])
    frame, label = read_frame(recording.images[row, 0]), float(recording.steering[row])
    how = "a copy of each sample" if flip == "both" else f"samples with probability {flip:g}"
    return [
        Heading("A flipped sample"),
        Text(f"The training mirrors {how}, and negates the steering."),
        Images(
            [
                labelled_frame("flip_before", frame, label, f"recorded: {_signed(label)}"),
                labelled_frame(
                    "flip_after", frame[:, ::-1].copy(), -label, f"mirrored: {_signed(-label)}"
                ),
            ],
            columns=3,
        ),
    ]


def _recovery(run: ReportedRun) -> list[Block]:
    recording = run.recording
    found = find_recovery(recording)
    rows = found.rows[np.linspace(0, len(found.rows) - 1, SHOWN).round().astype(int)]
    began = recording.time_s[rows[0]]
    images = []
    for number, row in enumerate(rows, 1):
        steering = float(recording.steering[row])
        time = recording.time_s[row] - began
        when = f"{time:.1f} s" if math.isfinite(time) else f"row {recording.line[row]}"
        caption = f"{when}: {_signed(steering)}"
        frame = read_frame(recording.images[row, 0])
        images.append(labelled_frame(f"recovery_{number}", frame, steering, caption))
    return [
        Heading("A recovery"),
        Text(f"{found.why} The stretch begins at {recording.place(int(rows[0]))}."),
        Images(images, columns=3),
    ]


def _fed(run: ReportedRun) -> list[Block]:
    names = ", ".join(run.config["data"].get("augment") or {}) or "none"
    image = run.plot(
        "fed_batch",
        f"Images of the first batches, as input to the network, with their labels. Augmentation: "
        f"{names}. The line points in the label's direction; full lock is 45 degrees.",
        "The run has no plot of the network's input (callbacks.fed_batch).",
    )
    return [Heading("Network input"), Images([smaller(image)])]


def _samples(run: ReportedRun, rows: np.ndarray):
    data = run.config["data"]
    cameras = [one for one in CAMERAS if one in data["cameras"]]
    if not cameras:
        raise MissingError("data.cameras does not name a known camera.")
    return make_samples(run.recording, rows, cameras, data["offset"], data.get("recover_s"))


def _signed(steering: float) -> str:
    return f"{steering + 0.0:+.3f}"


@dataclass(frozen=True)
class Recovery:
    """Consecutive rows of a recording (int64 [n]), and a text on how they were chosen."""

    rows: np.ndarray
    why: str


def find_recovery(recording: Recording) -> Recovery:
    """Return the most likely recovery of a recording, which holds no cross-track error.

    A driver who records recoveries pauses the recording on the way to the lane's edge, and resumes
    it for the way back. So search the stretches right after a pause first, then all stretches. The
    chosen stretch has the largest recovery response: the largest |steering| in its first half minus
    the mean of its last quarter.

    Raises:
        MissingError: no stretch is long enough, or the steering hardly changes in all of them.
    """
    stretches = find_stretches(recording)
    starts, length = stretches.first, stretches.length
    if not len(starts):
        raise MissingError(f"No stretch of the recording lasts {STRETCH_S:g} s without a pause.")
    for chosen, which in (
        (starts[stretches.after_pause], " that follow a pause in the recording"),
        (starts, " of the recording"),
    ):
        best, change = _best(recording, chosen, length)
        if best is None or change < LEAST_CHANGE:
            continue
        why = (
            f"This is the largest recovery response in the stretches of {STRETCH_S:g} s{which} "
            f"(number: {len(chosen):,}): the steering returns by {change:.2f}. The log does not "
            "contain the cross-track error."
        )
        if chosen is starts:
            why += " No recovery follows a pause, so this may be a sharp bend."
        return Recovery(np.arange(best, best + length), why)
    raise MissingError("The steering hardly changes anywhere in the recording.")


def _best(recording: Recording, starts: np.ndarray, length: int) -> tuple[int | None, float]:
    if not len(starts):
        return None, 0.0
    change = steering_returns(recording, starts, length)
    return int(starts[change.argmax()]), float(change.max())
