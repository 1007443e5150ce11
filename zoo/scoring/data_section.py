"""The section on the training data."""

import cv2
import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.image import decode_image, read_image
from datamodules.looking.findings import report_lines
from datamodules.recording import Recording
from datamodules.samples import make_samples
from datamodules.stretches import LEAST_CHANGE, STRETCH_S, find_stretches, steering_returns
from zoo.base.command_keys import typed
from zoo.base.errors import InputError
from zoo.scoring.blocks import Block, Bullets, Heading, Image, Images, Text
from zoo.scoring.reported_run import ReportedRun

SHOWN = 6  # number of frames of the recovery
WIDTH = 640  # of a frame
AMBER, DARK = (240, 173, 74), (20, 24, 28)
APART = (
    "Time from held-out rows to the nearest training row (median; below 1 s they are almost copies)"
)


def recordings(run: ReportedRun) -> list[Block]:
    """Return the figures of each recording."""
    recording = run.recording
    lines = report_lines(recording)
    if run.trained_on.fingerprint not in ("", recording.fingerprint()):
        lines.append(
            "The recording is not the one of the training: it was changed after it, or rows with "
            f"damaged images were skipped. It now has the fingerprint {recording.fingerprint()}."
        )
    return [Bullets(lines)]


def split(run: ReportedRun) -> list[Block]:
    """Return the parts of the split, and how similar they are."""
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
    seconds = {part: _number(leak["seconds"]) for part, leak in leaks.items()}
    if apart := [f"{part} {number} s" for part, number in seconds.items() if number != "-"]:
        blocks.append(Text(f"{APART}: {', '.join(apart)}."))
    return blocks


def balance(run: ReportedRun) -> list[Block]:
    """Return the histogram of the steering before and after balancing."""
    data = run.config["data"]
    caption = (
        f"Steering before and after balancing (data.straight_cap={typed(data.get('straight_cap'))} "
        f"data.flip={data['flip']})."
    )
    return [Heading("Balance"), Images([run.plot("steering_histogram", caption)])]


def cameras(run: ReportedRun) -> list[Block]:
    """Return a frame of each camera with its label, of a row with the median of the bends."""
    recording, data = run.recording, run.config["data"]
    used = [camera for camera in CAMERAS if camera in data["cameras"]]
    if not used:
        raise InputError("data.cameras does not name a known camera.")
    samples = make_samples(
        recording, np.arange(len(recording)), used, data["offset"], data.get("recover_s")
    )
    rows = samples.row[samples.camera == samples.camera.max()]  # the others have fewer images
    # Not straight ahead, and not the sharpest bend.
    row = rows[np.argsort(np.abs(recording.steering[rows]), kind="stable")[3 * len(rows) // 4]]
    labels = {
        CAMERAS[samples.camera[number]]: float(samples.steering[number])
        for number in np.flatnonzero(samples.row == row)
    }
    images = [
        labelled_frame(
            f"camera_{camera}",
            read_image(recording.images[row, CAMERAS.index(camera)]),
            labels[camera],
            f"{camera}: label",
        )
        for camera in ("left", "center", "right")
        if camera in labels
    ]
    return [
        Heading("One frame of each camera"),
        Text(
            f"{recording.place(int(row))}, which steers more than three of four rows: "
            f"{signed(recording.steering[row])}. Side cameras, if any: "
            f"data.offset={data['offset']:g} data.recover_s={typed(data.get('recover_s'))}."
        ),
        Images(images, columns=3),
    ]


def flipped(run: ReportedRun) -> list[Block]:
    """Return a frame and its flipped copy."""
    recording, flip = run.recording, run.config["data"]["flip"]
    if not flip:
        return [Text("No sample was flipped (data.flip=0).")]
    steering = np.abs(recording.steering)
    row = int(np.argsort(steering, kind="stable")[int(0.9 * (len(steering) - 1))])
    frame, label = read_image(recording.images[row, 0]), float(recording.steering[row])
    images = [
        labelled_frame("flip_before", frame, label, "recorded"),
        labelled_frame("flip_after", frame[:, ::-1].copy(), -label, "mirrored"),
    ]
    text = f"The training mirrors samples (data.flip={flip}), and negates the steering."
    return [Heading("A flipped sample"), Text(text), Images(images, columns=3)]


def recovery(run: ReportedRun) -> list[Block]:
    """Return frames of the most likely recovery."""
    recording = run.recording
    stretch, why = find_recovery(recording)
    rows = stretch[np.linspace(0, len(stretch) - 1, SHOWN).round().astype(int)]
    images = []
    for number, row in enumerate(rows, 1):
        steering, frame = float(recording.steering[row]), read_image(recording.images[row, 0])
        time = _number(recording.time_s[row] - recording.time_s[rows[0]])
        images.append(labelled_frame(f"recovery_{number}", frame, steering, f"{time} s"))
    return [
        Heading("A recovery"),
        Text(f"{why} The stretch begins at {recording.place(int(rows[0]))}."),
        Images(images, columns=3),
    ]


def fed(run: ReportedRun) -> list[Block]:
    """Return a plot of the network's input."""
    caption = (
        "Images of the first batches, as input to the network, with their labels. The line points "
        "in the label's direction; full lock is 45 degrees."
    )
    # Of many photographs, a JPEG is a fifth of the PNG.
    pixels = decode_image(run.plot("fed_batch", caption).data)
    return [Heading("Network input"), Images([Image.jpeg("fed_batch.jpg", pixels, caption)])]


def _number(value: float | None) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{value:.2f}"


def find_recovery(recording: Recording) -> tuple[np.ndarray, str]:
    """Return the rows of the most likely recovery, int64 [n], and how they were chosen.

    A driver who records recoveries pauses the recording on the way to the lane's edge, and resumes
    it for the way back. So search the stretches right after a pause first, then all stretches. The
    chosen stretch has the largest recovery response: the largest |steering| in its first half minus
    the mean of its last quarter.

    Raises:
        InputError: no stretch is long enough, or the steering hardly changes in all of them.
    """
    stretches = find_stretches(recording)
    if not len(stretches.first):
        raise InputError(f"No stretch of {STRETCH_S:g} s is known to be driven without a pause.")
    change = steering_returns(recording, stretches.first, stretches.length)
    after_pause = np.where(stretches.after_pause, change, 0.0)
    which, curve = "that follow a pause in the recording", after_pause
    if after_pause.max() < LEAST_CHANGE:
        which, curve = "of the recording (none follows a pause, so it may be a sharp bend)", change
    if curve.max() < LEAST_CHANGE:
        raise InputError("The steering hardly changes anywhere in the recording.")
    why = (
        f"Of the stretches of {STRETCH_S:g} s {which}: the steering returns most in this one, by "
        f"{curve.max():.2f}. The log does not contain the cross-track error."
    )
    return stretches.first[curve.argmax()] + np.arange(stretches.length), why


def labelled_frame(name: str, frame: np.ndarray, steering: float, caption: str) -> Image:
    """Return an enlarged frame with an arrow for the steering (-1..1), its last word.

    Full lock is 45 degrees, as in the plot of the network's input.
    """
    width, height = WIDTH, WIDTH * len(frame) // frame.shape[1]
    large = cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC)
    length, angle = 0.5 * height, steering * np.pi / 4
    foot = (width // 2, height - 1)
    tip = round(width / 2 + length * np.sin(angle)), round(foot[1] - length * np.cos(angle))
    for colour, thickness in ((DARK, 9), (AMBER, 5)):  # visible on light and dark roads
        cv2.arrowedLine(large, foot, tip, colour, thickness, cv2.LINE_AA, tipLength=0.12)
    return Image.jpeg(f"{name}.jpg", large, f"{caption} {signed(steering)}")


def signed(steering: float) -> str:
    """Return a steering as text, with its sign."""
    return f"{round(steering, 3) + 0.0:+.3f}"
