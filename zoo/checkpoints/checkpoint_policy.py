"""The policy of a checkpoint, and the loader of the policies of all files that drive."""

from pathlib import Path

import numpy as np
import torch

from zoo.base.process_pool import read_apart
from zoo.checkpoints.checkpoint import (
    Checkpoint,
    build_checkpoint,
    checked_contents,
    find_checkpoint,
    is_checkpoint,
    load_plain,
)
from zoo.checkpoints.engine import Engine, chosen_forward
from zoo.checkpoints.frame_memory import FrameMemory, SessionPolicy
from zoo.checkpoints.frozen_graph import NetworkPolicy, network_inputs
from zoo.checkpoints.onnx_policy import OnnxPolicy, is_onnx, run_once
from zoo.checkpoints.policy_base import Command, Policy, PolicyFunction, as_policy, output_command
from zoo.checkpoints.policy_kinds import policy_kind
from zoo.models.memory import Memory


class CheckpointPolicy(NetworkPolicy, SessionPolicy):
    """A policy with the view and the network of a checkpoint.

    >>> policy = load_policy("outputs/.../checkpoints/best.ckpt")  # doctest: +SKIP
    >>> policy(frame, 9.0)  # doctest: +SKIP
    Command(steering=-0.02, throttle=None, spread=None)

    Attributes:
        network: network in evaluation mode, on the CPU; must not be changed.
        forward: faster function with the outputs of `network`, or of its `step` if it has memory.
            `OnnxPolicy` lacks these two.
        view, config, data, name, parameters, takes_speed, outputs, predicts_spread: as in
            `OnnxPolicy`.
    """

    def __init__(self, checkpoint: Checkpoint, engine: Engine = "torch", threads: int = 1) -> None:
        super().__init__(checkpoint)
        self.forward, self.engine = chosen_forward(checkpoint, engine, threads)
        if isinstance(self.network, Memory):
            self.keep_memory(self.network.first_state(), self.network.window, self.data)

    def scored(self) -> "CheckpointPolicy":
        """Return a session that computes in double precision; see `double_forward`."""
        other = self.in_double(self.network)
        if isinstance(self.network, Memory) and not other.tied:
            state = self.network.first_state()
            first = [part.double() if part.is_floating_point() else part for part in state]
            other.memory = FrameMemory(first, self.window.stride)
        return other

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [H, W, 3].
            speed_mph: the car's speed in mph.
        """
        inputs = network_inputs(self.view(frame), speed_mph if self.takes_speed else None)
        if self.memory is None:
            outputs = self.forward(*inputs)[0].tolist()
            return self.for_car(output_command(outputs, self.predicts_spread))
        steps = self.memory.step(self.forward, *inputs)[0].clamp(-1, 1).numpy()
        return Command(*self.in_time(steps, speed_mph).tolist())


def load_policy(
    path: str | Path | Policy | PolicyFunction, threads: int = 1, engine: Engine = "torch"
) -> Policy:
    """Return the policy of a checkpoint, an ONNX file, or a file of an installed kind.

    Args:
        path: file, run's folder, or `latest`; see `find_checkpoint`. A function becomes a policy.
        threads: number of onnxruntime's threads; `torch.set_num_threads` sets torch's.
        engine: engine that runs a checkpoint's network, see `chosen_forward`; torch gives the same
            figures on each call.

    Raises:
        InputError: see `zoo.checkpoints.checkpoint.load_checkpoint`, `OnnxPolicy`, `PolicyKind` and
            `chosen_forward`.
    """
    if not isinstance(path, str | Path):
        return as_policy(path)
    if is_onnx(path):
        read_apart(run_once, Path(path))
        return OnnxPolicy(path, threads)
    path = find_checkpoint(path)
    contents = load_plain(path)
    kind = None if is_checkpoint(contents) else policy_kind(contents)
    if kind is not None:
        return kind.read(contents, path, threads, engine)
    checkpoint = build_checkpoint(checked_contents(contents, path), path)
    return CheckpointPolicy(checkpoint, engine, threads)
