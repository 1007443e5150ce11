"""The section on what a network learnt from."""

import math

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.recording_report import report_recordings
from datamodules.samples import make_samples
from zoo.report.blocks import Block, Heading, MissingError, Pictures, Rows, Text, gather
from zoo.report.recovery_stretch import find_recovery
from zoo.report.report_images import labelled_frame, read_frame, smaller
from zoo.report.reported_run import Run

SHOWN = 6  # frames of the recovery


def data_blocks(run: Run) -> list[Block]:
    """Rows, split, leak, histogram and pictures; each with a line why where it is missing."""
    return gather((_recordings, _split, _balance, _cameras, _flipped, _recovery, _fed), run)


def _recordings(run: Run) -> list[Block]:
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
    blocks: list[Block] = [Rows([*headers, "steering exactly 0", "mean mph"], rows)]
    trained_on = (run.metrics.get("data") or {}).get("fingerprint")
    if trained_on and trained_on != recording.fingerprint():
        blocks.append(
            Text(
                f"What stands there now is not what was trained on: {len(recording):,} rows, "
                f"fingerprint {recording.fingerprint()}. Rows with damaged pictures that were "
                "skipped, or a change since, can be why."
            )
        )
    return blocks


def _split(run: Run) -> list[Block]:
    data, settings = run.figures("data"), run.config["data"]
    sizes = ", ".join(f"{count:,} {part}" for part, count in data["split"].items())
    left_out = data["rows"] - sum(data["split"].values())
    blocks: list[Block] = [
        Text(
            f"{data['rows']:,} rows with fingerprint {data['fingerprint']}, split by "
            f"{settings['split']}: {sizes}; {left_out:,} rows between parts are in none. "
            "Validation and test rows are the centre camera with the recorded steering: never "
            "flipped, augmented, balanced or offset."
        )
    ]
    leaks = run.metrics.get("leak") or {}
    if leaks:
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
                "How much the split leaks (medians): the time from a held-out frame to the nearest "
                "training frame, and how much it differs from the most alike training frame, as a "
                "share of how much any two differ. Near 0 s and 0 %, held-out rows are near copies "
                "of training rows, and their figures say little."
            ),
            Rows(["rows", "seconds to training", "difference to the most alike"], rows),
        ]
    return blocks


def _balance(run: Run) -> list[Block]:
    data = run.config["data"]
    cap, threshold = data.get("straight_cap"), data["straight_threshold"]
    said = "no cap on straight driving"
    if cap is not None:
        said = f"at most {cap:.0%} of a batch is steered less than {threshold:g}"
    both = data["flip"] == "both"
    flipped = "every sample both ways" if both else f"flipped with probability {data['flip']}"
    picture = run.plot(
        "steering_histogram",
        f"Steering before and after balancing: {said}; {flipped}.",
        "The run drew no histogram of its steering (callbacks.steering_histogram).",
    )
    return [Heading("Balance"), Pictures([picture])]


def _cameras(run: Run) -> list[Block]:
    recording, data = run.recording, run.config["data"]
    samples = _samples(run, np.arange(len(recording)))
    used = [camera for camera in CAMERAS if camera in data["cameras"]]
    count = np.bincount(samples.row, minlength=len(recording))
    rows = np.flatnonzero(count == count.max())
    # Neither straight ahead nor the sharpest bend there is.
    bends = rows[np.abs(recording.steering[rows]) >= data["straight_threshold"]]
    rows = bends if len(bends) else rows
    row = rows[np.argsort(np.abs(recording.steering[rows]), kind="stable")[len(rows) // 2]]
    pictures = []
    for camera in ("left", "center", "right"):
        sample = _samples(run, np.array([row]))
        own = np.flatnonzero(sample.camera == CAMERAS.index(camera))
        if camera not in used or not len(own):
            continue
        steering = float(sample.steering[own[0]])
        frame = read_frame(recording.images[row, CAMERAS.index(camera)])
        caption = f"{camera}: fed with steering {_signed(steering)}"
        pictures.append(labelled_frame(f"camera_{camera}", frame, steering, caption))
    how = f"offset by {data['offset']:g}"
    if data.get("recover_s") is not None:
        how = f"corrected to be back in the middle in {data['recover_s']:g} s"
    return [
        Heading("One frame of each camera"),
        Text(
            f"{recording.place(int(row))}, the bend of the median steering: recorded "
            f"{_signed(recording.steering[row])}, side cameras {how}."
        ),
        Pictures(pictures, columns=3),
    ]


def _flipped(run: Run) -> list[Block]:
    recording, data = run.recording, run.config["data"]
    flip = data["flip"]
    if not flip:
        return [Text("Nothing was flipped (data.flip=0).")]
    steering = np.abs(recording.steering)
    row = int(np.argsort(steering, kind="stable")[int(0.9 * (len(steering) - 1))])
    frame, label = read_frame(recording.images[row, 0]), float(recording.steering[row])
    how = "every sample comes both ways" if flip == "both" else f"with probability {flip:g}"
    return [
        Heading("Flipped"),
        Text(f"A sample is mirrored, and its steering negated, {how}."),
        Pictures(
            [
                labelled_frame("flip_before", frame, label, f"recorded: {_signed(label)}"),
                labelled_frame(
                    "flip_after", frame[:, ::-1].copy(), -label, f"mirrored: {_signed(-label)}"
                ),
            ],
            columns=3,
        ),
    ]


def _recovery(run: Run) -> list[Block]:
    recording = run.recording
    found = find_recovery(recording)
    rows = found.rows[np.linspace(0, len(found.rows) - 1, SHOWN).round().astype(int)]
    began = recording.time_s[rows[0]]
    pictures = []
    for number, row in enumerate(rows, 1):
        steering = float(recording.steering[row])
        time = recording.time_s[row] - began
        when = f"{time:.1f} s" if math.isfinite(time) else f"row {recording.line[row]}"
        caption = f"{when}: {_signed(steering)}"
        frame = read_frame(recording.images[row, 0])
        pictures.append(labelled_frame(f"recovery_{number}", frame, steering, caption))
    return [
        Heading("A recovery"),
        Text(f"{found.why} It begins at {recording.place(int(rows[0]))}."),
        Pictures(pictures, columns=3),
    ]


def _fed(run: Run) -> list[Block]:
    names = ", ".join(run.config["data"].get("augment") or {}) or "none"
    picture = run.plot(
        "fed_batch",
        f"The first batches as the network was fed them, each with its label. Augmentation: {names}"
        ". The arrow points where the label steers; full lock is 45 degrees.",
        "The run drew no batch as fed (callbacks.fed_batch).",
    )
    return [Heading("As fed"), Pictures([smaller(picture)])]


def _samples(run: Run, rows: np.ndarray):
    data = run.config["data"]
    cameras = [one for one in CAMERAS if one in data["cameras"]]
    if not cameras:
        raise MissingError("The run was trained on no camera that is known.")
    return make_samples(run.recording, rows, cameras, data["offset"], data.get("recover_s"))


def _signed(steering: float) -> str:
    return f"{steering + 0.0:+.3f}"
