"""Cached features of a network's frozen layers (`model.cache_features`).

They are computed once for each image instead of in every epoch, stored in the views' cache, and fed
in place of the images. That changes no gradient and no random draw: frozen weights give the same
features for the same image. Half precision changes features by up to 1/2048 of their value;
`docs/models/vgg.md` has its effect on steering.
"""

import hashlib

import numpy as np
import torch
from omegaconf import DictConfig
from rich.console import Console
from torch import nn

from datamodules.driving import DrivingData
from datamodules.features import FeaturePlan, Front, plan_features
from datamodules.run_data import RunData
from zoo.base.errors import InputError
from zoo.base.terminal import counted, print_line
from zoo.checkpoints.checkpoint import part_cards
from zoo.models.layers import in_pieces
from zoo.models.network_facts import facts_of

KEY = "model.cache_features"
REMEDY = "set a smaller model.size, fewer data.cameras, or data.cache=FOLDER on another disk"
# `auto` uses at most this many bytes. Free bytes do not decide: features of half precision train
# other weights.
AUTO_BYTES = 16_000_000_000


def plan_cached_features(
    config: DictConfig,
    network: nn.Module,
    data: RunData,
    device: torch.device,
    threads: int,
    console: Console,
) -> FeaturePlan | None:
    """Return which features of the frozen front to train on, as `model.cache_features` says.

    Args:
        config: experiment's config.
        network: network with the weights that training starts from.
        data: loaded data.
        device: device that computes features and trains.
        threads: number of threads that do, on which features depend.
        console: console for the decision.

    Returns:
        The plan, before anything is computed; None to train on images.

    Raises:
        InputError: the setting is not auto, true or false; or it is true and nothing is frozen,
            images are augmented, batches are windows, or there is no space; or features exceed
            half precision.
    """
    setting = config.model.get("cache_features", False)
    if setting not in ("auto", True, False):
        raise InputError(f"{KEY}={setting} is not auto, true or false")
    frozen = facts_of(network).frozen_front
    if setting is False:
        return None
    if frozen is not None and isinstance(data, DrivingData):
        network.to(device)
        made_by = [threads, part_cards(dict(config.model))]
        plan = _refusal(config, data) or _plan(config, _front(frozen, data, made_by), data)
    elif setting == "auto":
        return None
    else:
        plan = "no block of the network is frozen; set a lower model.trainable_blocks"
    if isinstance(plan, FeaturePlan):
        if plan.missing_bytes > (free := plan.free_bytes()):
            raise InputError(
                f"{KEY}={setting}: caching takes {_size(plan.missing_bytes)}, with {_size(free)} "
                f"free {_place(plan)}; {REMEDY}, or {KEY}=false"
            )
        size = f"{counted(plan.images, 'image')}, {plan.front.image_bytes / 1e3:.1f} kB each"
        if plan.missing:
            size = f"{plan.missing:,} of {size}, {_size(plan.missing_bytes)}"
        print_line(console, f"frozen blocks: caching the features of {size}, {_place(plan)}")
        return plan
    if setting is True:
        raise InputError(f"{KEY}=true: {plan}, or {KEY}=false")
    print_line(console, f"frozen blocks are computed in every epoch: {plan}")
    return None


def _plan(config: DictConfig, front: Front, data: DrivingData) -> FeaturePlan | str:
    """Return the plan; where `auto` does not cache, why, and what to set."""
    plan = plan_features(
        data.recording,
        data.views,
        data.options.cameras,
        data.view,
        front,
        mirrored=data.options.flip != 0,
        cache=data.options.cache_folder,
    )
    if config.model.cache_features is True:
        return plan
    return _too_large(plan, config, data) or plan


def _refusal(config: DictConfig, data: DrivingData) -> str | None:
    """Return why features cannot be cached, and what to set; None if they can."""
    if changes := [name for name, settings in (config.data.augment or {}).items() if settings]:
        return f"augment=[{','.join(changes)}] changes every image; set augment=[]"
    if data.views.shards:
        return "shards may be larger than the disk; train on a log"
    if data.windows.is_windowed:
        return (
            f"data.sequence={data.windows.sequence} data.ahead={data.windows.ahead} make windows, "
            "and features are of single frames; set a model of single frames"
        )
    return None


def _too_large(plan: FeaturePlan, config: DictConfig, data: DrivingData) -> str | None:
    """Return why `auto` does not cache, and what to set; None if it does."""
    epoch_images = data.epoch_samples() + len(data.split.val)
    draws = config.trainer.max_epochs * epoch_images + len(data.recording)
    if draws < plan.images:
        return f"the training reads {draws:,} images of {plan.images:,}; set {KEY}=true"
    if (size := plan.images * plan.front.image_bytes) > AUTO_BYTES:
        return f"caching takes {_size(size)}, of which auto takes {_size(AUTO_BYTES)}; {REMEDY}"
    return None


def _place(plan: FeaturePlan) -> str:
    return f"in {plan.folder}" if plan.folder else "in memory (data.cache=null)"


def _front(frozen: nn.Module, data: DrivingData, made_by: list) -> Front:
    device = next(frozen.parameters()).device

    @torch.inference_mode()
    def compute(batch: np.ndarray) -> np.ndarray:
        features = in_pieces(frozen, torch.from_numpy(batch).permute(0, 3, 1, 2).to(device)).half()
        if not torch.isfinite(features).all():
            raise InputError(f"features exceed 65,504, the largest half; set {KEY}=false")
        return features.permute(0, 2, 3, 1).contiguous().cpu().numpy()

    shape = compute(np.zeros((1, *data.view.shape), np.uint8)).shape[1:]
    # Sums are rounded in another order by other threads, processors and versions of PyTorch. Names
    # and weights of a user's layers do not tell what they compute.
    by = [*made_by, device.type, torch.backends.cpu.get_cpu_capability(), torch.__version__]
    return Front(compute, shape, f"{fingerprint(frozen)} {by}")


def fingerprint(frozen: nn.Module) -> str:
    """Return the hash of a module's layers and weights."""
    digest = hashlib.sha256(repr(frozen).encode())
    for name, tensor in (*frozen.named_parameters(), *frozen.named_buffers()):
        digest.update(f"{name} {tensor.dtype} {list(tensor.shape)}".encode())
        digest.update(tensor.detach().float().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def _size(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"
