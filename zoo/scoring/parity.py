"""Comparison of an exported network with its checkpoint, frame by frame."""

import statistics
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch

from datamodules.format_options import said_in
from datamodules.image import read_image
from datamodules.recording_format import read_recordings
from zoo.base.compose import compose_config
from zoo.base.errors import InputError
from zoo.base.machine import processor_name
from zoo.base.rig import CURVATURE
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_path import on_server, trained_data
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.frame_memory import SessionPolicy
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy_base import Command
from zoo.driving.run_drives import one_thread
from zoo.models.memory import Memory

FRAMES = 64
CALIBRATION = 200
RENDERED = 24
WARM_UP = 3
PYTORCH = "PyTorch"


@dataclass(frozen=True)
class Frames:
    """The inputs on which two policies are compared.

    Attributes:
        frames: camera frames, each uint8 [H, W, 3] RGB.
        speeds_mph: speed at each frame.
        source: origin of the frames, as in "64 frames of FOLDER".
    """

    frames: list[np.ndarray]
    speeds_mph: list[float]
    source: str


@dataclass(frozen=True)
class Parity:
    """The result of a comparison.

    Attributes:
        difference: largest difference of steering or throttle, each -1..1; NaN if a policy
            returned NaN.
        mean: mean difference over the frames.
        checkpoint_ms, exported_ms: median times per frame, with the view.
    """

    difference: float
    mean: float
    checkpoint_ms: float
    exported_ms: float


def take_frames(recording: str | None, checkpoint: Checkpoint, count: int = FRAMES) -> Frames:
    """Return frames of a recording, or frames of the embedded lake in the size of the network's.

    Args:
        recording: folder to read; None tries the recording of the training, then the embedded
            lake's.
        checkpoint: checkpoint of the network.
        count: largest number of frames.

    Raises:
        InputError: the given recording cannot be read, or rendering fails.
    """
    if recording is not None:
        return _frames_of(recording, count, {})
    data = trained_data(checkpoint.config, checkpoint.data)
    root, frames = data.get("root"), None
    with suppress(InputError, OSError, RuntimeError):  # on another machine, or incomplete
        if root and not on_server(root):
            return _frames_of(root, count, said_in(data))
    with suppress(InputError, OSError):
        frames = _frames_of(compose_config(["data=lake"])["data"]["record"]["out"], count, {})
    frames, (rows, columns) = frames or _rendered_frames(), checkpoint.view.frame
    why = f", since the training's recording {root} is not found here; name it, frames=FOLDER"
    return Frames(
        [
            cv2.resize(frame, (columns, rows), interpolation=cv2.INTER_AREA)
            for frame in frames.frames
        ],
        frames.speeds_mph,
        f"{frames.source}, in {columns} x {rows}{why if root else ''}",
    )


def compare(policy: CheckpointPolicy, exported: SessionPolicy, frames: Frames) -> Parity:
    """Compare two policies on each frame, and time them on one thread.

    Policies with memory get the frames as one drive, and those that predict ahead are asked for
    another time at each frame. The network of an ONNX file also runs on all frames as one batch,
    since it accepts any batch size. A curvature is compared as it is: no car is driven.
    """
    policies = (policy.session(), exported.session())
    for session in policies:
        session.data = {**session.data, CURVATURE: None}
    times_ms: tuple[list[float], list[float]] = ([], [])
    answers: tuple[list[list[float]], list[list[float]]] = ([], [])
    with one_thread():
        for _ in range(WARM_UP):
            for timed in policies:
                timed(frames.frames[0], 0.0)
        for timed in policies:
            timed.reset()
        for number, (frame, speed_mph) in enumerate(
            zip(frames.frames, frames.speeds_mph, strict=True)
        ):
            for which in (0, 1) if number % 2 else (1, 0):
                if policies[which].window.ahead:
                    policies[which].latency_s = number % 4 * 0.15
                began = time.perf_counter()
                command = policies[which](frame, speed_mph)
                times_ms[which].append(1000 * (time.perf_counter() - began))
                answers[which].append(_outputs(command))
    expected, outputs = (np.array(answer, dtype=float) for answer in answers)
    differences = [np.abs(outputs - expected).max()]
    if isinstance(exported, OnnxPolicy):
        images = np.stack([exported.view(frame) for frame in frames.frames])
        batched = exported.predict(images, np.array(frames.speeds_mph))
        network = policy.network
        in_batch = _first_steps(network, images) if isinstance(network, Memory) else expected
        differences.append(np.abs(batched - in_batch).max())
    return Parity(
        difference=float(np.max(differences)),
        mean=float(np.abs(outputs - expected).mean()),
        checkpoint_ms=statistics.median(times_ms[0]),
        exported_ms=statistics.median(times_ms[1]),
    )


def latency(times_ms: Mapping[str, float], frames: int) -> str:
    """Return a sentence on the time that a frame takes with each engine, by the engine's name."""
    times = ", ".join(f"{time_ms:.2f} ms with {engine}" for engine, time_ms in times_ms.items())
    return (
        f"Latency: a frame takes {times}, on one thread of {processor_name()} (median of {frames})."
    )


def own_latency(checkpoint: Checkpoint) -> str:
    """Return a sentence on the time that a frame takes with PyTorch, measured on noise."""
    frame = np.random.default_rng(0).integers(0, 256, (*checkpoint.view.frame, 3), np.uint8)
    policy = CheckpointPolicy(checkpoint)
    frames = Frames([frame] * RENDERED, [0.0] * RENDERED, "of noise")
    return latency({PYTORCH: compare(policy, policy, frames).checkpoint_ms}, RENDERED)


def _outputs(command: Command) -> list[float]:
    numbers = (command.steering, command.throttle, command.spread)
    return [number for number in numbers if number is not None]


@torch.inference_mode()
def _first_steps(network: Memory, images: np.ndarray) -> np.ndarray:
    """Return the outputs for images, each the first frame of a drive, [N, 1 + ahead, outputs]."""
    steps, *_ = network.step(
        torch.from_numpy(images).permute(0, 3, 1, 2), *network.first_state(len(images))
    )
    return steps.clamp(-1, 1).numpy()


def _frames_of(folder: str | list[str], count: int, said: Mapping[str, Any]) -> Frames:
    recording = read_recordings(folder, **{**said, "on_bad_image": "skip"})
    rows = np.unique(np.linspace(0, len(recording) - 1, count).round().astype(int))
    frames = []
    for row in rows:
        path = recording.images[row, 0]
        try:
            frames.append(read_image(path))
        except (OSError, ValueError) as error:
            raise InputError(f"{recording.place(row)}: {path}: {error}") from None
    return Frames(frames, recording.speed_mph[rows].tolist(), f"of {', '.join(recording.names)}")


def _rendered_frames() -> Frames:
    """Return frames all around the embedded lake, on the centreline and 1 m off each side."""
    from zoo.simulator.simulated_world import Start, open_world

    try:
        world = open_world("lake", "auto")
    except InputError as error:
        raise InputError(f"cannot render frames ({error}); add frames=RECORDING") from None
    frames, speeds_mph = [], np.linspace(0, 30, RENDERED).tolist()
    for number, speed_mph in enumerate(speeds_mph):
        side = number % 3 - 1
        start = Start(number * world.track.length / RENDERED, side, 5.0 * side, speed_mph)
        world.reset(number, start)
        frames.append(world.frame())
    world.close()
    return Frames(frames, speeds_mph, "rendered on the embedded lake")
