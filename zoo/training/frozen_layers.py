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
from zoo.base.errors import InputError
from zoo.base.terminal import print_line

KEY = "model.cache_features"
# `auto` uses at most this many bytes of a disk or memory, and at most half of the free bytes.
AUTO_BYTES = 16_000_000_000


def plan_cached_features(
    config: DictConfig,
    network: nn.Module,
    data: DrivingData,
    device: torch.device,
    console: Console,
) -> FeaturePlan | None:
    """Return which features of the frozen front to train on, as `model.cache_features` says.

    Args:
        config: experiment's config.
        network: network with the weights that training starts from.
        data: loaded data.
        device: device that computes features and trains.
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
    if setting is False:
        return None
    frozen = getattr(network, "frozen_front", None)
    if frozen is None:
        if setting is True:
            raise InputError(
                f"{KEY}=true: no block of the network is frozen; lower model.trainable_blocks"
            )
        return None
    changes = [name for name, settings in (config.data.augment or {}).items() if settings]
    if changes:
        listed = ",".join(changes)
        if setting is True:
            raise InputError(
                f"{KEY}=true: augment=[{listed}] changes every image, and features exist only for "
                f"recorded and mirrored images; set augment=[], or {KEY}=false"
            )
        print_line(
            console,
            f"frozen blocks are computed again in every epoch, because of augment=[{listed}]; "
            "with augment=[] they are computed once",
        )
        return None
    if data.windows.is_windowed:
        if setting is True:
            raise InputError(
                f"{KEY}=true: features are cached for single frames, and data.sequence="
                f"{data.windows.sequence} data.ahead={data.windows.ahead} make windows; set "
                f"{KEY}=false"
            )
        print_line(console, "frozen blocks are computed again in every epoch, because of windows")
        return None
    plan = plan_features(
        data.recording,
        data.views,
        data.cameras,
        data.view,
        _front(network.to(device), frozen, data),
        mirrored=data.flip != 0,
        cache=data.cache,
    )
    return plan if _is_wanted(setting, plan, _draws(config, data), console) else None


def random_front_lines(weights: str | None, network: nn.Module) -> list[str]:
    """Return a warning line if frozen layers have random weights.

    Args:
        weights: value of `model.weights`.
        network: network to train.
    """
    if weights is not None or getattr(network, "frozen_front", None) is None:
        return []
    return [
        "frozen blocks keep their random weights (model.weights=null): random features; "
        "a larger model.trainable_blocks trains them"
    ]


def _front(network: nn.Module, frozen: nn.Module, data: DrivingData) -> Front:
    device = next(frozen.parameters()).device

    @torch.inference_mode()
    def compute(batch: np.ndarray) -> np.ndarray:
        images = torch.from_numpy(batch).permute(0, 3, 1, 2).to(device)
        features = network.front(images).half()
        if not torch.isfinite(features).all():
            raise InputError(f"features exceed 65,504, the largest half; set {KEY}=false")
        return features.permute(0, 2, 3, 1).contiguous().cpu().numpy()

    shape = compute(np.zeros((1, *data.view.shape), np.uint8)).shape[1:]
    return Front(compute, shape, fingerprint(frozen))


def fingerprint(frozen: nn.Module) -> str:
    """Return the hash of a module's layers and weights."""
    digest = hashlib.sha256(repr(frozen).encode())
    for name, tensor in (*frozen.named_parameters(), *frozen.named_buffers()):
        digest.update(f"{name} {tensor.dtype} {list(tensor.shape)}".encode())
        digest.update(tensor.detach().float().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def _draws(config: DictConfig, data: DrivingData) -> int:
    """Return the number of images that the whole training reads, also for a resumed run."""
    epoch = len(data.sampler()) * data.batch_size + len(data.split.val)
    return config.trainer.max_epochs * epoch + len(data.recording)


def _is_wanted(setting: object, plan: FeaturePlan, draws: int, console: Console) -> bool:
    """Return whether to cache features; print their size, or why they are not cached.

    Raises:
        InputError: `model.cache_features=true`, and there is no space.
    """
    if setting == "auto" and draws < plan.images:
        print_line(
            console,
            f"frozen blocks are computed when needed: the training reads {draws:,} images of "
            f"{plan.images:,} ({KEY}=true computes all of them, for other runs)",
        )
        return False
    where = f"in {plan.folder}" if plan.folder else "in memory (data.cache=null)"
    needed, free = plan.missing_bytes, plan.free_bytes()
    if needed > free or (setting == "auto" and needed > min(free / 2, AUTO_BYTES)):
        words = f"{_size(needed)} of features of frozen blocks, with {_size(free)} free {where}"
        remedy = "a smaller model.size, fewer data.cameras, or data.cache=FOLDER on another disk"
        if setting is True:
            raise InputError(f"{KEY}=true: {words}; set {remedy}, or {KEY}=false")
        print_line(
            console,
            f"frozen blocks are computed again in every epoch: caching them would take "
            f"{words}; set {remedy}",
        )
        return False
    size = f"{plan.images:,} images, {plan.front.image_bytes / 1e3:.1f} kB each"
    if plan.missing:
        print_line(
            console,
            f"frozen blocks: computing the features of {plan.missing:,} of {size}, "
            f"{_size(needed)} {where}",
        )
    else:
        print_line(console, f"frozen blocks: the features of {size}, are in {plan.folder}")
    return True


def _size(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"
