"""What a network looks at, after VisualBackProp: Bojarski et al., 2016, arXiv:1611.05418."""

import copy
from dataclasses import dataclass

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from datamodules.batches import make_batch
from datamodules.errors import InputError
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy import Policy

POOLS = (nn.MaxPool2d, nn.AvgPool2d)
COPIES, NOISE = 16, 0.1  # of SmoothGrad: pictures averaged, deviation as a share of 0..255
GREEN = (60, 255, 90)


@dataclass(frozen=True)
class Stage:
    """What one layer did: the height and width that went in, and what came out, [1, C, H, W]."""

    layer: nn.Module
    size: tuple[int, int]
    features: Tensor


class Saliency:
    """Where in a frame the evidence for the steering is, for any network of the zoo.

    VisualBackProp averages what each convolution lets through its ReLU over the channels, and
    multiplies these maps down from the deepest, each enlarged by the kernel and stride of the
    layers between. With ELU, what is let through is no measure: on the lake it lit up bushes and
    sky, while greying out road edges was what changed the steering. So here each feature counts by
    how far it is from its mean over the picture times the gradient of the steering by it, and the
    root of the product is shown. `python benchmarks/saliency.py CKPT RECORDING` holds both against
    greying out: rank correlations of 0.66 here and 0.22 as published, for a PilotNet.

    A network without `nn.Conv2d` (`tiny`, whose rows are channels) has no such maps. There it is
    the gradient times the picture's deviation from its mean, averaged over noisy copies
    (SmoothGrad: Smilkov et al., 2017, arXiv:1706.03825).

    Args:
        policy: whose view and network are looked through.
        published: VisualBackProp to the letter, which costs no backward pass.

    Raises:
        InputError: the policy is an ONNX file's.

    >>> where = Saliency(policy)(frame, 9.0)  # doctest: +SKIP
    >>> picture = overlay(frame, where)  # doctest: +SKIP
    """

    def __init__(self, policy: Policy, published: bool = False) -> None:
        if isinstance(policy, OnnxPolicy):
            raise InputError(
                f"{policy.path}: is ONNX, which cannot be looked through; it drives all the same, "
                "and the checkpoint that it was made of can"
            )
        self.view, self.published = policy.view, published
        # A copy: its hooks must neither slow the driving down nor hear of it from another thread.
        self.network = copy.deepcopy(policy.network).eval()
        self.stages: list[Stage] = []
        layers = [one for one in self.network.modules() if isinstance(one, (nn.Conv2d, *POOLS))]
        self.has_maps = any(isinstance(one, nn.Conv2d) for one in layers)
        for layer in layers if self.has_maps else ():
            layer.register_forward_hook(self._note)

    def __call__(self, frame: np.ndarray, speed_mph: float) -> np.ndarray:
        """Frame uint8 [160, 320, 3] RGB and mph -> float32 [160, 320] in 0..1, in the frame's own
        pixels: what the view crops off is 0."""
        nothing = np.zeros(1)
        batch = make_batch(self.view(frame)[None], nothing, nothing, np.array([speed_mph]))
        find = self._visual_back_prop if self.has_maps else self._smooth_gradient
        with torch.enable_grad():
            return self._in_frame(find(batch["images"].float(), batch["speed"]))

    def _visual_back_prop(self, images: Tensor, speed: Tensor) -> Tensor:
        self.stages.clear()
        steering = self._steering(images.requires_grad_(), speed)
        stages, self.stages = self.stages, []
        features = [stage.features for stage in stages]
        gradients = [None] * len(stages)
        if not self.published:
            gradients = torch.autograd.grad(steering, features)
        where, maps = torch.ones(1, 1, *features[-1].shape[2:]), 0
        for stage, gradient in zip(reversed(stages), reversed(gradients), strict=True):
            if isinstance(stage.layer, nn.Conv2d):
                where = where * feature_map(stage.features.detach(), gradient)
                # The scale is of no account, and a product of many maps would leave float's range.
                where, maps = where / where.max().clamp(min=1e-30), maps + 1
            where = enlarge(where, stage.layer, stage.size, even=not self.published)
        return where[0, 0] if self.published else where[0, 0] ** (1 / maps)

    def _smooth_gradient(self, images: Tensor, speed: Tensor) -> Tensor:
        noise = torch.randn((COPIES, *images.shape[1:]), generator=torch.Generator().manual_seed(0))
        noisy = (images + 255 * NOISE * noise).requires_grad_()
        steering = self._steering(noisy, speed.expand(COPIES))
        gradient = torch.autograd.grad(steering.sum(), noisy)[0].mean(0)
        return (gradient * (images[0] - images.mean())).abs().sum(0)

    def _steering(self, images: Tensor, speed: Tensor) -> Tensor:
        return self.network(images, *((speed,) if self.network.takes_speed else ()))[:, 0]

    def _note(self, layer: nn.Module, inputs: tuple[Tensor], output: Tensor) -> None:
        self.stages.append(Stage(layer, tuple(inputs[0].shape[2:]), output))

    def _in_frame(self, where: Tensor) -> np.ndarray:
        top, bottom = self.view.crop
        whole = np.zeros((FRAME_HEIGHT, FRAME_WIDTH), np.float32)
        seen = cv2.resize(where.float().numpy(), (FRAME_WIDTH, FRAME_HEIGHT - top - bottom))
        seen -= seen.min()
        whole[top : FRAME_HEIGHT - bottom] = seen / max(float(seen.max()), 1e-30)
        return whole


def feature_map(features: Tensor, gradient: Tensor | None) -> Tensor:
    """A convolution's `[1, C, H, W]`, before its activation, as one map `[1, 1, H, W]`."""
    if gradient is None:
        return features.relu().mean(1, keepdim=True)
    deviation = features - features.mean((2, 3), keepdim=True)
    return (gradient * deviation).abs().mean(1, keepdim=True)


def enlarge(where: Tensor, layer: nn.Module, size: tuple[int, int], even: bool = False) -> Tensor:
    """A map `[1, 1, h, w]` of the output of a convolution or a pooling as one of its input, of
    `size` (height, width): a transposed convolution of ones.

    `even` divides by how many outputs see a pixel: without, as published, a kernel of 5 on a stride
    of 2 draws a chequerboard, and the rim fades.
    """
    kernel, stride, padding = (
        (value, value) if isinstance(value, int) else value
        for value in (layer.kernel_size, layer.stride, layer.padding)
    )
    ones = torch.ones(1, 1, *kernel)
    spread = F.conv_transpose2d(where, ones, stride=stride)
    if even:
        seen_by = F.conv_transpose2d(torch.ones_like(where), ones, stride=stride)
        spread = spread / seen_by.clamp(min=1)
    # A layer that pads its input by itself says 0: the excess is that, its end has the odd row.
    skipped = [
        pad or max(have - want, 0) // 2
        for pad, have, want in zip(padding, spread.shape[2:], size, strict=True)
    ]
    spread = spread[..., skipped[0] :, skipped[1] :][..., : size[0], : size[1]]
    # Pixels that no output sees, at the end where the stride does not fit.
    return F.pad(spread, (0, size[1] - spread.shape[3], 0, size[0] - spread.shape[2]))


def overlay(frame: np.ndarray, where: np.ndarray) -> np.ndarray:
    """A frame uint8 [160, 320, 3] RGB with what matters in green; `where` float [160, 320] 0..1."""
    share = 0.9 * where.clip(0, 1)[..., None] ** 2  # small values are many and say little
    return (frame * (1 - share) + np.array(GREEN) * share).astype(np.uint8)
