"""`trainer.precision=auto`: the rule that chooses bfloat16 or 32 bits before a training.

Nothing is measured: the load of the moment would choose. Gains by network and processor, and drives
of networks of both precisions, are in docs/performance.md#bfloat16.
"""

import lightning
import torch
from lightning.pytorch.plugins import FSDPPrecision, MixedPrecision, Precision
from lightning.pytorch.utilities import GradClipAlgorithmType
from omegaconf import DictConfig
from rich.console import Console
from torch import nn

from datamodules.view import View
from zoo.base.process_ranks import needs_processes
from zoo.base.terminal import print_line
from zoo.models.make_network import multiply_adds
from zoo.training.host_settings import AUTO, FULL, HALF, multiplies_bf16

# Networks of 1.0 million gained 1.0 to 1.1, those of 24 million and more 1.2 to 2.1.
# On an H100 PilotNet gained 1.3.
LEAST_OPERATIONS = 10_000_000  # multiply-adds of convolutions and dense layers for an image

AMPERE = (8, 0)  # compute capability of the first GPUs with bfloat16


def choose_precision(
    config: DictConfig,
    network: nn.Module,
    view: View,
    console: Console,
    before: str | None = None,
    bf16: bool | None = None,
) -> str:
    """Return `trainer.precision`, with a choice in place of `auto`; print it and the other one.

    Args:
        config: experiment's config.
        network: network that is trained.
        view: what the network sees.
        console: console for that line.
        before: precision of the checkpoint that a run resumes, which it keeps; None for a new run.
        bf16: whether the processor has bfloat16 instructions; None for this processor.
    """
    asked = config.trainer.get("precision", FULL)
    if asked != AUTO:
        return str(asked)
    if before in (FULL, HALF):  # a checkpoint may name anything
        return before
    where, accelerator = "processor", config.trainer.accelerator
    has_bf16 = multiplies_bf16() if bf16 is None else bf16
    if accelerator != "cpu" and torch.cuda.is_available():
        where, has_bf16 = "GPU", torch.cuda.get_device_capability() >= AMPERE
    elif accelerator not in ("auto", "cpu"):
        has_bf16 = False
    # Several processes may run on different processors.
    if not has_bf16 or needs_processes(config):
        return FULL
    height, width, channels = view.shape
    count = multiply_adds(network, (channels, height, width))
    chosen, other = (HALF, FULL) if count >= LEAST_OPERATIONS else (FULL, HALF)
    limit = f"{'at least' if chosen == HALF else 'fewer than'} {LEAST_OPERATIONS / 1e6:g} million"
    print_line(
        console,
        f"trainer.precision=auto: {chosen}, since this {where} has bfloat16 instructions and "
        f"the network {limit} multiply-adds an image ({count / 1e6:.1f} million); or set "
        f"trainer.precision={other}",
    )
    return chosen


def clip_gradients(
    module: lightning.LightningModule,
    optimizer: torch.optim.Optimizer,
    value: float | None,
    algorithm: str | None,
) -> None:
    """Clip the gradients of a module that Lightning trains.

    Lightning refuses a fused optimizer, as in 16 bits with scaled gradients, which such an
    optimizer takes. In bfloat16 gradients are not scaled.
    """
    plugin = module.trainer.precision_plugin
    is_scaled = isinstance(plugin, MixedPrecision | FSDPPrecision) and plugin.scaler
    if not value or is_scaled:
        module.clip_gradients(optimizer, value, algorithm)
        return
    Precision.clip_gradients(plugin, optimizer, value, GradClipAlgorithmType(algorithm or "norm"))
