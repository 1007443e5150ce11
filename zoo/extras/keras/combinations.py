"""Inputs that a network of 2016 to 2022 may have been trained with, and frames to try them on."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from datamodules.image import read_image
from datamodules.recording import Recording
from datamodules.view import CONVERSIONS, FRAME, RESIZES, View
from zoo.base.errors import InputError
from zoo.base.terminal import command_line, counted

Scale = tuple[float, float]
Pair = tuple[int, int]

# Rows off the top and the bottom in published solutions of the course's project: none, then the
# most frequent first. (60, 25) and (50, 20) stood before a resize to 66 x 200, (32, 25) before one
# to 64 x 64; (70, 25) and (50, 20) are the course's own Cropping2D.
CROPS: tuple[Pair, ...] = (
    (0, 0), (60, 25), (70, 25), (50, 20), (60, 20), (65, 25), (55, 25), (50, 25),
    (65, 20), (70, 20), (40, 20), (32, 25), (80, 20), (40, 25), (60, 30), (40, 0),
)  # fmt: skip
# The network computes pixel / scale[0] - scale[1]: x/127.5-1, x/255-0.5, x/255, (x-128)/128, x.
SCALES: tuple[Scale, ...] = ((127.5, 1.0), (255.0, 0.5), (255.0, 0.0), (128.0, 1.0), (1.0, 0.0))
USUAL_RESIZE = "area"
USUAL_CROP = (60, 25)
MOVING_MPH = 1.0
BEND = 0.05  # least |steering| of a row that shows which way the road bends
LEAST_ROWS = 60


@dataclass(frozen=True)
class Combination:
    """A view, and the scale of its pixels: the network computes `pixel / scale[0] - scale[1]`."""

    view: View
    scale: Scale

    def text(self) -> str:
        """Return the keys of `drivezoo import` that choose this combination.

        >>> Combination(View((60, 25), "yuv", (66, 200)), (127.5, 1.0)).text()
        "colour=yuv 'crop=[60,25]' 'size=[66,200]' resize=area 'scale=[127.5,1]'"
        """
        view = self.view
        keys = [f"colour={view.colour}", f"crop={_pair(view.crop)}"]
        keys += [f"size={_pair(view.size)}", f"resize={view.resize}"] if view.size else []
        return command_line([*keys, f"scale={_pair(self.scale)}"])


# The whole input of a popular course (rslim087a, "The Complete Self-Driving Car Course"), whose
# networks often learned from a recording of another track.
POPULAR = Combination(View((60, 25), "yuv", (66, 200), "blur_linear"), (255.0, 0.0))


@dataclass(frozen=True, kw_only=True)
class KnownInput:
    """What is known of a network's input from its file or from the user; None is not known.

    Attributes:
        shape: input's `(height, width, channels)`.
        colour, crop, resize: as in `View`.
        scale: as in `Combination`.
        frame: height and width of the training's frames.
    """

    shape: tuple[int, int, int]
    colour: str | None = None
    crop: Pair | None = None
    resize: str | None = None
    scale: Scale | None = None
    frame: Pair = FRAME


def combinations(facts: KnownInput) -> list[Combination]:
    """Return the combinations that fit what is known, the likeliest first, resized by area.

    Raises:
        InputError: no view has the network's input shape.
    """
    fitting = [
        Combination(view, scale)
        for scale in ([facts.scale] if facts.scale else SCALES)
        for view in _views(facts)
    ]
    if not fitting:
        height, width, channels = facts.shape
        raise InputError(
            f"colour={facts.colour}: the network's input is {height} x {width} x {channels}; set a "
            f"colour of {counted(channels, 'channel')}"
        )
    return fitting


def likeliest_combination(facts: KnownInput) -> Combination:
    """Return the most usual combination that fits what is known.

    It is a view of the cropped frame as it is, or else one after a crop of (60, 25).
    """
    views = ((combination.view, combination) for combination in combinations(facts))
    return min(views, key=lambda pair: (pair[0].size is not None, pair[0].crop != USUAL_CROP))[1]


def with_each_resize(chosen: Combination, facts: KnownInput) -> list[Combination]:
    """Return a combination with each way of resizing that is possible, its own first."""
    if facts.resize or chosen.view.size is None:
        return [chosen]
    ways = [way for way in RESIZES if way != chosen.view.resize]
    # A single channel of an RGB image is resized the same before and after the conversion.
    if chosen.view.colour in ("rgb", "bgr"):
        ways = [way for way in ways if not way.endswith("_first")]
    return [chosen, *(replace(chosen, view=replace(chosen.view, resize=way)) for way in ways)]


def popular_combinations(facts: KnownInput) -> list[Combination]:
    """Return `POPULAR` if it fits what is known; else an empty list."""
    resize = facts.resize or POPULAR.view.resize
    return [POPULAR] if POPULAR in combinations(replace(facts, resize=resize)) else []


def _views(facts: KnownInput) -> Iterator[View]:
    for colour in [facts.colour] if facts.colour else CONVERSIONS:
        for crop in _crops(facts):
            view = View(crop, colour, None, facts.resize or USUAL_RESIZE, facts.frame)
            if view.shape[:2] != facts.shape[:2]:
                view = replace(view, size=facts.shape[:2])
            if view.shape == facts.shape:
                yield view


def _crops(facts: KnownInput) -> Sequence[Pair]:
    if facts.crop is not None:
        return [facts.crop]
    return CROPS[:1] if facts.shape[:2] == FRAME else CROPS


def _pair(pair: Sequence[float]) -> str:
    return f"[{','.join(f'{number:g}' for number in pair)}]"


@dataclass(frozen=True)
class TrialFrames:
    """Frames with their recorded steering, in the order of driving.

    Attributes:
        cameras: frames of the centre camera, or of the centre, left and right ones, uint8
            [cameras, N, H, W, 3] RGB.
        steering: recorded steering, -1..1, float64 [N].
    """

    cameras: np.ndarray
    steering: np.ndarray

    def every(self, step: int) -> "TrialFrames":
        """Return every `step`-th row."""
        return TrialFrames(self.cameras[:, ::step], self.steering[::step])

    def center_only(self) -> "TrialFrames":
        """Return the frames without the side cameras."""
        return TrialFrames(self.cameras[:1], self.steering)


def choose_rows(recording: Recording, count: int) -> np.ndarray:
    """Return at most `count` rows in bends, evenly spread over the recording, int64.

    Raises:
        InputError: the car moves and steers in too few rows.
    """
    names = np.array(recording.names)[recording.recording]
    moving = np.isin(names, recording.without_speed) | (recording.speed_mph > MOVING_MPH)
    rows = np.flatnonzero(moving & (np.abs(recording.steering) >= BEND))
    if len(rows) < LEAST_ROWS:
        raise InputError(
            f"{', '.join(recording.names)}: only {len(rows)} of {len(recording)} rows move and "
            f"steer by {BEND:g} or more, {LEAST_ROWS} are needed to find the input; name a longer "
            "recording, with bends"
        )
    return rows[np.unique(np.linspace(0, len(rows) - 1, count).round().astype(int))]


def read_trial_frames(
    recording: Recording, count: int, show: Callable[[float], None] = lambda share: None
) -> TrialFrames:
    """Decode the images of at most `count` rows.

    Args:
        recording: recording in the order of driving.
        count: most rows.
        show: function called with the finished share of the work, 0..1.

    Raises:
        InputError: an image cannot be read, or see `choose_rows`.
    """
    rows = choose_rows(recording, count)
    has_sides = all(path is not None for path in recording.images[rows].flat)
    height, width = recording.frame_size() or FRAME
    frames = np.empty((3 if has_sides else 1, len(rows), height, width, 3), np.uint8)
    for number, row in enumerate(rows):
        for camera, images in enumerate(frames):
            path = recording.images[row, camera]
            try:
                images[number] = cv2.resize(read_image(path), (width, height))
            except (OSError, ValueError) as error:
                raise InputError(
                    f"{recording.place(row)}: {path}: {error}; copy the image again, or name "
                    "another recording"
                ) from None
        show((number + 1) / len(rows))
    return TrialFrames(frames, recording.steering[rows])
