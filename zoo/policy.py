"""What a checkpoint, or the ONNX file made of one, becomes for anyone who drives."""

from pathlib import Path

import numpy as np
import torch

from datamodules.batches import make_batch
from zoo.checkpoint import Checkpoint, load_checkpoint
from zoo.onnx_policy import OnnxPolicy, is_onnx


class Policy:
    """`policy(frame, speed)` with the view and the network of a checkpoint.

    >>> policy = load_policy("outputs/.../checkpoints/best.ckpt")  # doctest: +SKIP
    >>> steering, throttle = policy(frame, 9.0)  # doctest: +SKIP

    Attributes:
        network: ready, in evaluation mode, on the CPU; the one thing that `OnnxPolicy` has not.
        view, config, data, name, parameters, takes_speed, outputs: as `OnnxPolicy` has them.
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.network, self.view = checkpoint.network, checkpoint.view
        self.config, self.data = checkpoint.config, checkpoint.data
        self.name = type(self.network).__name__
        self.parameters = sum(one.numel() for one in self.network.parameters())
        self.takes_speed, self.outputs = self.network.takes_speed, self.network.outputs

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> tuple[float, float | None]:
        """Frame uint8 [160, 320, 3] RGB and mph -> steering -1..1, and throttle -1..1 (negative
        brakes) or None from a network that predicts none."""
        nothing = np.zeros(1)
        batch = make_batch(self.view(frame)[None], nothing, nothing, np.array([speed_mph]))
        speed = (batch["speed"],) if self.network.takes_speed else ()
        out = self.network(batch["images"], *speed)[0].clamp(-1, 1).tolist()
        return out[0], out[1] if len(out) > 1 else None


def load_policy(path: str | Path, threads: int = 1) -> Policy | OnnxPolicy:
    """The policy of a checkpoint, or of a `.onnx` file of `python -m zoo.export`.

    Args:
        path: the file.
        threads: of onnxruntime; torch's are set by `torch.set_num_threads`.

    Raises:
        InputError: as `load_checkpoint` and `OnnxPolicy` do.
    """
    return OnnxPolicy(path, threads) if is_onnx(path) else Policy(load_checkpoint(path))
