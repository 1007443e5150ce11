"""The policy of a checkpoint, and the loader for checkpoints and ONNX files."""

from pathlib import Path

import numpy as np
import torch

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import (
    Checkpoint,
    build_checkpoint,
    checked_contents,
    doubt_members,
    find_checkpoint,
    load_plain,
)
from zoo.checkpoints.command import Command, output_command
from zoo.checkpoints.doubt_file import build_doubt
from zoo.checkpoints.doubt_policy import DropoutPolicy, EnsemblePolicy
from zoo.checkpoints.frame_memory import SessionPolicy
from zoo.checkpoints.frozen_graph import NetworkPolicy, network_inputs, quick_forward
from zoo.checkpoints.onnx_policy import OnnxPolicy, is_onnx
from zoo.models.memory import Memory


class CheckpointPolicy(NetworkPolicy, SessionPolicy):
    """A policy with the view and the network of a checkpoint.

    >>> policy = load_policy("outputs/.../checkpoints/best.ckpt")  # doctest: +SKIP
    >>> policy(frame, 9.0)  # doctest: +SKIP
    Command(steering=-0.02, throttle=None, spread=None, limit_mph=None)

    Attributes:
        network: network in evaluation mode, on the CPU; must not be changed.
        forward: faster function with the outputs of `network`, or of its `step` if it has memory.
            `OnnxPolicy` lacks these two.
        view, config, data, name, parameters, takes_speed, outputs, predicts_spread: as in
            `OnnxPolicy`.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        super().__init__(checkpoint)
        self.forward = quick_forward(self.network, self.view)
        if isinstance(self.network, Memory):
            self.keep_memory(self.network.first_state(), self.network.window, self.data)

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [H, W, 3].
            speed_mph: the car's speed in mph.
        """
        inputs = network_inputs(self.view(frame), speed_mph if self.takes_speed else None)
        if self.memory is None:
            return output_command(self.forward(*inputs)[0].tolist(), self.predicts_spread)
        steps = self.memory.step(self.forward, *inputs)[0].clamp(-1, 1).numpy()
        return Command(*self.in_time(steps, speed_mph).tolist())


def load_policy(
    path: str | Path, threads: int = 1
) -> CheckpointPolicy | OnnxPolicy | DropoutPolicy | EnsemblePolicy:
    """Return the policy of a checkpoint, or of a file of `drivezoo export` or `drivezoo doubt`.

    Args:
        path: file, run's folder, or `latest`; see `find_checkpoint`.
        threads: number of onnxruntime's threads; `torch.set_num_threads` sets torch's.

    Raises:
        InputError: see `zoo.checkpoints.checkpoint.load_checkpoint`, `OnnxPolicy`, `build_doubt`
            and `DropoutPolicy`.
    """
    if is_onnx(path):
        return OnnxPolicy(path, threads)
    path = find_checkpoint(path)
    contents = load_plain(path)
    if doubt_members(contents) is None:
        return CheckpointPolicy(build_checkpoint(checked_contents(contents, path), path))
    return doubt_policy(contents, path)


def doubt_policy(contents: dict, path: Path) -> DropoutPolicy | EnsemblePolicy:
    """Return the policy of the contents of a file of `drivezoo doubt`.

    Raises:
        InputError: see `build_doubt` and `DropoutPolicy`.
    """
    members, settings = build_doubt(contents, path)
    if len(members) > 1:
        return EnsemblePolicy([CheckpointPolicy(one) for one in members])
    try:
        return DropoutPolicy(members[0], settings.samples, settings.seed)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
