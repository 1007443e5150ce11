"""Does an exported network steer as its checkpoint does? Both are asked, frame by frame."""

import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from datamodules.errors import InputError
from datamodules.image import read_image
from datamodules.recording import read_recordings
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy import Policy

FRAMES = 64
RENDERED = 24
WARM_UP = 3


@dataclass(frozen=True)
class Frames:
    """What two policies are compared on.

    Attributes:
        frames: uint8 [160, 320, 3] RGB each.
        speeds_mph: one a frame.
        source: where they are from, as in "64 frames of FOLDER".
    """

    frames: list[np.ndarray]
    speeds_mph: list[float]
    source: str


@dataclass(frozen=True)
class Parity:
    """How two policies compare.

    Attributes:
        difference: the largest, of steering or throttle, each -1..1; NaN where either says NaN.
        checkpoint_ms, onnx_ms: median times of a frame, its view included.
    """

    difference: float
    checkpoint_ms: float
    onnx_ms: float


def take_frames(recording: str | None, config: dict) -> Frames:
    """Frames of a recording; without one, of that which the checkpoint was trained on, or of the
    embedded lake's; where neither is on this disk, frames are rendered.

    Raises:
        InputError: the recording named cannot be read, or there is none and nothing renders.
    """
    if recording is not None:
        return _frames_of(recording)
    for folder, images in _recordings_at_hand(config):
        try:
            return _frames_of(folder, images)
        except (InputError, OSError):  # another machine's, or half of it is gone
            continue
    return _rendered_frames()


def compare(policy: Policy, exported: OnnxPolicy, frames: Frames) -> Parity:
    """Ask both for each frame, by turns, on one thread each; and the exported network for all
    frames at once, since its batch may be of any size."""
    policies, times_ms, answers = (policy, exported), ([], []), ([], [])
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for _ in range(WARM_UP):
            for one in policies:
                one(frames.frames[0], 0.0)
        for number, (frame, speed_mph) in enumerate(
            zip(frames.frames, frames.speeds_mph, strict=True)
        ):
            for which in (0, 1) if number % 2 else (1, 0):
                began = time.perf_counter()
                answer = policies[which](frame, speed_mph)
                times_ms[which].append(1000 * (time.perf_counter() - began))
                answers[which].append([one for one in answer if one is not None])
    finally:
        torch.set_num_threads(threads)
    pictures = np.stack([exported.view(frame) for frame in frames.frames])
    at_once = exported.predict(pictures, np.array(frames.speeds_mph))
    expected, found = (np.array(one, dtype=float) for one in answers)
    return Parity(
        difference=float(np.abs([found - expected, at_once - expected]).max()),
        checkpoint_ms=statistics.median(times_ms[0]),
        onnx_ms=statistics.median(times_ms[1]),
    )


def _frames_of(folder: str | list[str], images: str | None = None) -> Frames:
    recording = read_recordings(folder, images, on_bad_image="skip")
    rows = np.unique(np.linspace(0, len(recording) - 1, FRAMES).round().astype(int))
    frames = []
    for row in rows:
        path = Path(recording.images[row, 0])
        try:
            frames.append(read_image(path))
        except (OSError, ValueError) as error:
            raise InputError(f"{recording.place(row)}: {path}: {error}") from None
    source = f"of {', '.join(recording.names)}"
    return Frames(frames, recording.speed_mph[rows].tolist(), source)


def _recordings_at_hand(config: dict) -> list[tuple[str | list[str], str | None]]:
    from zoo.cli.compose import compose_config

    data = config.get("data", {})
    embedded = compose_config(["data=lake"])["data"]["record"]["out"]
    places = [(data.get("root"), data.get("images")), (embedded, None)]
    return [(root, images) for root, images in places if root]


def _rendered_frames() -> Frames:
    """Of the embedded lake, all around it, and now and then beside the centreline."""
    from simulator.errors import SimulatorError
    from simulator.world import Start, open_world

    try:
        world = open_world("lake", "auto")
    except SimulatorError as error:
        raise InputError(f"nothing renders frames here ({error}); add frames=RECORDING") from None
    frames, speeds_mph = [], np.linspace(0, 30, RENDERED).tolist()
    for number, speed_mph in enumerate(speeds_mph):
        aside = number % 3 - 1
        start = Start(number * world.track.length / RENDERED, aside, 5.0 * aside, speed_mph)
        world.reset(number, start)
        frames.append(world.frame())
    world.pictures.close()
    return Frames(frames, speeds_mph, "rendered on the embedded lake")
