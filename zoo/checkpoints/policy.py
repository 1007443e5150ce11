"""What a checkpoint, or the ONNX file made of one, becomes for anyone who drives."""

from pathlib import Path

import numpy as np
import torch

from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.frozen_graph import network_inputs, quick_forward
from zoo.checkpoints.onnx_policy import OnnxPolicy, is_onnx


class Policy:
    """`policy(frame, speed)` with the view and the network of a checkpoint.

    >>> policy = load_policy("outputs/.../checkpoints/best.ckpt")  # doctest: +SKIP
    >>> steering, throttle = policy(frame, 9.0)  # doctest: +SKIP

    Attributes:
        network: ready, in evaluation mode, on the CPU; not to be changed any more.
        forward: what `network` does, sooner; these two `OnnxPolicy` has not.
        view, config, data, name, parameters, takes_speed, outputs: as `OnnxPolicy` has them.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.network, self.view = checkpoint.network, checkpoint.view
        self.config, self.data = checkpoint.config, checkpoint.data
        self.name = type(self.network).__name__
        self.parameters = sum(one.numel() for one in self.network.parameters())
        self.takes_speed, self.outputs = self.network.takes_speed, self.network.outputs
        self.forward = quick_forward(self.network, self.view)

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> tuple[float, float | None]:
        """Frame uint8 [160, 320, 3] RGB and mph -> steering -1..1, and throttle -1..1 (negative
        brakes) or None from a network that predicts none."""
        inputs = network_inputs(self.view(frame), speed_mph if self.takes_speed else None)
        out = self.forward(*inputs)[0].clamp(-1, 1).tolist()
        return out[0], out[1] if len(out) > 1 else None


def load_policy(path: str | Path, threads: int = 1) -> Policy | OnnxPolicy:
    """Return the policy of a checkpoint, or of a `.onnx` file of `python -m zoo.export`.

    Args:
        path: file, run's folder, or `latest`: see `find_checkpoint`.
        threads: number of onnxruntime's; torch's are set by `torch.set_num_threads`.

    Raises:
        InputError: as `load_checkpoint` and `OnnxPolicy` do.
    """
    return OnnxPolicy(path, threads) if is_onnx(path) else Policy(load_checkpoint(path))
