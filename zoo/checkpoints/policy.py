"""The policy of a checkpoint, and the loader for checkpoints and ONNX files."""

from pathlib import Path

import numpy as np
import torch

from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.command import Command
from zoo.checkpoints.frozen_graph import network_inputs, quick_forward
from zoo.checkpoints.onnx_policy import OnnxPolicy, is_onnx


class Policy:
    """A policy with the view and the network of a checkpoint.

    >>> policy = load_policy("outputs/.../checkpoints/best.ckpt")  # doctest: +SKIP
    >>> policy(frame, 9.0)  # doctest: +SKIP
    Command(steering=-0.02, throttle=None, spread=None, limit_mph=None)

    Attributes:
        network: network in evaluation mode, on the CPU; must not be changed.
        forward: faster function with the outputs of `network`. `OnnxPolicy` lacks these two.
        view, config, data, name, parameters, takes_speed, outputs: as in `OnnxPolicy`.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.network, self.view = checkpoint.network, checkpoint.view
        self.config, self.data = checkpoint.config, checkpoint.data
        self.name = type(self.network).__name__
        self.parameters = sum(one.numel() for one in self.network.parameters())
        self.takes_speed, self.outputs = self.network.takes_speed, self.network.outputs
        self.forward = quick_forward(self.network, self.view)

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the command for a frame.

        Args:
            frame: RGB image of the centre camera, uint8 [160, 320, 3].
            speed_mph: the car's speed in mph.
        """
        inputs = network_inputs(self.view(frame), speed_mph if self.takes_speed else None)
        out = self.forward(*inputs)[0].clamp(-1, 1).tolist()
        return Command(*out)


def load_policy(path: str | Path, threads: int = 1) -> Policy | OnnxPolicy:
    """Return the policy of a checkpoint, or of a `.onnx` file of `python -m zoo.export`.

    Args:
        path: file, run's folder, or `latest`; see `find_checkpoint`.
        threads: number of onnxruntime's threads; `torch.set_num_threads` sets torch's.

    Raises:
        InputError: see `load_checkpoint` and `OnnxPolicy`.
    """
    return OnnxPolicy(path, threads) if is_onnx(path) else Policy(load_checkpoint(path))
