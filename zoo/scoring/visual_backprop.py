"""Saliency maps by VisualBackProp, Bojarski et al. 2016, arXiv:1611.05418."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from datamodules.batches import make_batch
from zoo.base.errors import InputError
from zoo.checkpoints.frozen_graph import NetworkPolicy
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy_base import Policy
from zoo.models.layers import Crop
from zoo.models.memory import frame_outputs

# Layers that move or resize a map, besides convolutions.
MOVES = (nn.MaxPool2d, nn.AvgPool2d, nn.ZeroPad2d, Crop)
COPIES, NOISE = 16, 0.1  # SmoothGrad's number of noisy copies, and their deviation in parts of 255
GREEN = (60, 255, 90)


@dataclass(frozen=True)
class Stage:
    """A layer's call: height and width of its input, and its output, [1, C, H, W]."""

    layer: nn.Module
    size: tuple[int, int]
    features: Tensor


class Saliency:
    """Saliency map of a frame: how much each pixel moves the steering of a network.

    VisualBackProp averages the ReLU output of each convolution over its channels. From the deepest
    layer upwards it multiplies these maps, each enlarged by the kernel and stride of the layers
    between. This fails with ELU: on the lake it marked bushes and sky, although greying out the
    road's edges changed the steering. Here, a feature therefore counts by the absolute value of
    (feature - its mean over the image) * (gradient of the steering by the feature), and the root of
    the product is shown. The rank correlation with greying out patches is 0.66 for a PilotNet, and
    0.22 for VisualBackProp as published (over 11 frames).

    A network without `nn.Conv2d`, such as `tiny`, has no such maps. Its saliency is the gradient
    times the image's deviation from its mean, averaged over noisy copies (SmoothGrad, Smilkov et
    al. 2017, arXiv:1706.03825).

    A network with memory is shown a frame as at a start, without frames before.

    Args:
        policy: policy whose view and network are used.
        published: whether to compute VisualBackProp as published, without a backward pass.

    Raises:
        InputError: the policy is an ONNX file or an ensemble.

    >>> where = Saliency(policy)(frame, 9.0)  # doctest: +SKIP
    >>> image = overlay(frame, where)  # doctest: +SKIP
    """

    def __init__(self, policy: Policy, published: bool = False) -> None:
        if not isinstance(policy, NetworkPolicy):
            name = policy.path if isinstance(policy, OnnxPolicy) else policy.name
            raise InputError(
                f"{name}: an ONNX file or an ensemble has no gradients for the saliency; "
                "name the checkpoint that it was written from"
            )
        self.view, self.published = policy.view, published
        # A copy, since hooks would slow the driving down, and record it from another thread.
        self.network = copy.deepcopy(policy.network).eval()
        self.stages: list[Stage] = []
        layers = [
            module for module in self.network.modules() if isinstance(module, (nn.Conv2d, *MOVES))
        ]
        self.has_maps = any(isinstance(layer, nn.Conv2d) for layer in layers)
        for layer in layers if self.has_maps else ():
            layer.register_forward_hook(self._note)

    def __call__(self, frame: np.ndarray, speed_mph: float) -> np.ndarray:
        """Return the saliency of each pixel, float32 [H, W] in 0..1; 0 where the view crops.

        Args:
            frame: camera frame, uint8 [H, W, 3] RGB.
            speed_mph: speed of the car.
        """
        nothing = np.zeros(1)
        batch = make_batch(self.view(frame)[None], nothing, nothing, np.array([speed_mph]))
        find = self._visual_back_prop if self.has_maps else self._smooth_gradient
        with torch.enable_grad():
            return self._in_frame(find(batch["images"].float(), batch["speed"]), *frame.shape[:2])

    def _visual_back_prop(self, images: Tensor, speed: Tensor) -> Tensor:
        self.stages.clear()
        steering = self._steering(images.requires_grad_(), speed)
        stages, self.stages = self.stages, []
        features = [stage.features for stage in stages]
        gradients: Sequence[Tensor | None] = [None] * len(stages)
        if not self.published:
            gradients = torch.autograd.grad(steering, features)
        where, maps = torch.ones(1, 1, *features[-1].shape[2:]), 0
        for stage, gradient in zip(reversed(stages), reversed(gradients), strict=True):
            if where.shape[2:] != stage.features.shape[2:]:  # a layer between them resizes
                where = F.interpolate(where, stage.features.shape[2:], mode="bilinear")
            # A convolution over its whole input, such as the sensors of `ncp`, has no map.
            if isinstance(stage.layer, nn.Conv2d) and stage.features[0, 0].numel() > 1:
                where = where * feature_map(stage.features.detach(), gradient)
                # Normalize each product: the scale does not matter, and many maps could overflow.
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
        return frame_outputs(self.network, images, speed)[:, 0]

    def _note(self, layer: nn.Module, inputs: tuple[Tensor], output: Tensor) -> None:
        _, _, height, width = inputs[0].shape
        self.stages.append(Stage(layer, (height, width), output))

    def _in_frame(self, where: Tensor, height: int, width: int) -> np.ndarray:
        top, bottom = self.view.rows_cropped(height)
        whole = np.zeros((height, width), np.float32)
        seen = cv2.resize(where.float().numpy(), (width, height - top - bottom))
        seen -= seen.min()
        whole[top : height - bottom] = seen / max(float(seen.max()), 1e-30)
        return whole


def feature_map(features: Tensor, gradient: Tensor | None) -> Tensor:
    """Return a convolution's output before its activation, [1, C, H, W], as a map [1, 1, H, W]."""
    if gradient is None:
        return features.relu().mean(1, keepdim=True)
    return (gradient * (features - features.mean((2, 3), keepdim=True))).abs().mean(1, keepdim=True)


def enlarge(where: Tensor, layer: nn.Module, size: tuple[int, int], even: bool = False) -> Tensor:
    """Return a map of a layer's input from a map of its output, by a transposed convolution.

    Args:
        where: map of the output, [1, 1, h, w].
        layer: convolution, pooling, cropping or padding.
        size: height and width of the layer's input.
        even: whether to divide by the number of outputs that see a pixel. Without it, as published,
            a kernel of 5 with a stride of 2 draws a chequerboard and fades at the border.
    """
    if isinstance(layer, Crop):
        return F.pad(where, (layer.left, layer.right, layer.top, layer.bottom))
    if isinstance(layer, nn.ZeroPad2d):
        return F.pad(where, [-count for count in layer.padding])
    kernel, stride = _pair(layer.kernel_size), _pair(layer.stride)
    padding, dilation = _pair(layer.padding), _pair(getattr(layer, "dilation", 1))
    ones = torch.ones(1, 1, *kernel)
    spread = F.conv_transpose2d(where, ones, stride=stride, dilation=dilation)
    if even:
        seen_by = F.conv_transpose2d(torch.ones_like(where), ones, stride=stride, dilation=dilation)
        spread = spread / seen_by.clamp(min=1)
    # A layer that pads its own input reports a padding of 0. Its padding is the excess, whose odd
    # row is at the end.
    skipped = [
        pad or max(have - want, 0) // 2
        for pad, have, want in zip(padding, spread.shape[2:], size, strict=True)
    ]
    spread = spread[..., skipped[0] :, skipped[1] :][..., : size[0], : size[1]]
    # Pad the pixels at the end that no output sees, where the stride does not fit.
    return F.pad(spread, (0, size[1] - spread.shape[3], 0, size[0] - spread.shape[2]))


def _pair(value: Any) -> tuple[int, int]:
    return (value, value) if isinstance(value, int) else value


def overlay(frame: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return a frame with its saliency in green.

    Args:
        frame: camera frame, uint8 [H, W, 3] RGB.
        where: saliency, float [H, W] in 0..1.
    """
    share = 0.9 * where.clip(0, 1)[..., None] ** 2  # the square hides many small values
    return (frame * (1 - share) + np.array(GREEN) * share).astype(np.uint8)
