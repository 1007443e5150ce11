"""The parameter groups of an optimizer: which weights decay, and at which rate they learn."""

import math

from torch import nn

from zoo.base.errors import InputError
from zoo.models.network_facts import facts_of


def optimizer_groups(network: nn.Module, l2: float, backbone_lr: float | None) -> list[dict]:
    """Return parameter groups: weights decay, biases do not; a backbone may have its own rate.

    Without `l2` no group has a `weight_decay`: the optimizer's own counts for all.
    Each group costs a call of the optimizer, so there are as few as possible.

    Args:
        network: network that is trained.
        l2: factor of the sum of squared weights in the loss.
        backbone_lr: learning rate of the network's backbone; None for the optimizer's.

    Raises:
        InputError: all layers are frozen.
    """
    backbone = facts_of(network).backbone
    slow = {id(p) for p in backbone.parameters()} if backbone is not None else set()
    groups: dict[tuple[bool, bool], list[nn.Parameter]] = {}
    for parameter in network.parameters():
        if parameter.requires_grad:
            has_rate = id(parameter) in slow and backbone_lr is not None
            groups.setdefault((has_rate, parameter.ndim > 1 and l2 > 0), []).append(parameter)
    if not groups:
        raise InputError("no parameter can be trained; set model.trainable_blocks above 0")
    return [
        {
            "params": parameters,
            # The gradient of l2 * w^2 is 2 * l2 * w; torch's weight_decay w adds w itself.
            **({"weight_decay": 2 * l2 if decays else 0.0} if l2 else {}),
            **({"lr": backbone_lr} if has_rate else {}),
        }
        for (has_rate, decays), parameters in groups.items()
    ]


def lr_scale(optimizer: str, lr_batch: int | None, batch_size: int | None) -> float:
    """Return the factor on a learning rate that was chosen for batches of `lr_batch` samples.

    For SGD it is the ratio of the sizes (Goyal et al. 2017, arXiv:1706.02677), for optimizers that
    divide by the gradient's size its square root (Malladi et al. 2022, arXiv:2205.10287).
    """
    ratio = batch_size / lr_batch if batch_size and lr_batch else 1.0
    return ratio if optimizer == "torch.optim.SGD" else math.sqrt(ratio)
