"""What a checkpoint, or the ONNX file made of one, becomes for anyone who drives."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from datamodules.view import View
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
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


def network_inputs(picture: np.ndarray, speed_mph: float | None) -> tuple[Tensor, ...]:
    """A view uint8 [H, W, C] as a network takes it in a batch of one, laid out as when it trained;
    and the speed, where it takes that."""
    images = torch.from_numpy(picture[None]).permute(0, 3, 1, 2)
    return (images,) if speed_mph is None else (images, torch.tensor([speed_mph]).float())


def quick_forward(network: nn.Module, view: View) -> Callable[..., Tensor]:
    """The network as a frozen graph, if its outputs are the same to the bit; else the network.

    A picture is so little work that a sixth of PilotNet's 1.4 ms are Python's, between the layers,
    and a tenth copies, which lay the weights out anew for every picture.
    """
    speed = 20.0 if network.takes_speed else None
    pictures = np.random.default_rng(0).integers(0, 256, (3, *view.shape), np.uint8)
    inputs = [network_inputs(picture, speed) for picture in pictures]
    with warnings.catch_warnings():
        # Deprecated, and not replaced: what `torch.export` makes is slower than the network.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", torch.jit.TracerWarning)  # the size is always the view's
        try:
            with torch.inference_mode():
                wanted = [network(*one) for one in inputs]
            # As the pictures are; values stay. (torch's overloads lack memory_format alone.)
            network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
            with torch.no_grad():
                traced = torch.jit.trace(network, inputs[0], check_trace=False)
            frozen = torch.jit.freeze(traced)
            with torch.inference_mode():  # the graph is arranged while it runs for the first times
                outs = [frozen(*one) for one in inputs]
            same = all(map(torch.equal, outs, wanted))
        except Exception:  # whatever a network does that no graph can
            same = False
    if same:
        return frozen
    network.to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]
    return network


def load_policy(path: str | Path, threads: int = 1) -> Policy | OnnxPolicy:
    """Return the policy of a checkpoint, or of a `.onnx` file of `python -m zoo.export`.

    Args:
        path: file, run's folder, or `latest`: see `find_checkpoint`.
        threads: number of onnxruntime's; torch's are set by `torch.set_num_threads`.

    Raises:
        InputError: as `load_checkpoint` and `OnnxPolicy` do.
    """
    return OnnxPolicy(path, threads) if is_onnx(path) else Policy(load_checkpoint(path))
