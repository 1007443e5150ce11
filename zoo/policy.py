"""What a checkpoint becomes for anyone who drives."""

from pathlib import Path

import numpy as np
import torch

from datamodules.batches import make_batch
from zoo.checkpoint import Checkpoint, load_checkpoint


class Policy:
    """`policy(frame, speed)` with the view and the network of a checkpoint.

    >>> policy = load_policy("outputs/.../checkpoints/best.ckpt")  # doctest: +SKIP
    >>> steering, throttle = policy(frame, 9.0)  # doctest: +SKIP
    """

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.network, self.view = checkpoint.network, checkpoint.view

    @torch.inference_mode()
    def __call__(self, frame: np.ndarray, speed_mph: float) -> tuple[float, float | None]:
        """Frame uint8 [160, 320, 3] RGB and mph -> steering -1..1, and throttle -1..1 (negative
        brakes) or None from a network that predicts none."""
        nothing = np.zeros(1)
        batch = make_batch(self.view(frame)[None], nothing, nothing, np.array([speed_mph]))
        speed = (batch["speed"],) if self.network.takes_speed else ()
        out = self.network(batch["images"], *speed)[0].clamp(-1, 1).tolist()
        return out[0], out[1] if len(out) > 1 else None


def load_policy(path: str | Path) -> Policy:
    """The policy of a checkpoint; raises InputError as `load_checkpoint` does."""
    return Policy(load_checkpoint(path))
