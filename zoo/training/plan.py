"""A training's plan: all of it that depends on the machine, worked out once.

What a network learns does not depend on it.
"""

import os
from dataclasses import dataclass

import lightning
import torch
from omegaconf import DictConfig
from rich.console import Console
from torch import nn

from datamodules.balance import share_of
from datamodules.batch_groups import GROUP
from datamodules.cores import usable_cores
from datamodules.driving import DrivingData
from datamodules.errors import InputError
from datamodules.features import FeaturePlan
from zoo.training.compilation import resolve_compile
from zoo.training.frozen_layers import plan_cached_features
from zoo.training.host_settings import multiplies_bf16

# A step of so small a network costs less than two threads' meeting: 52,000 samples/s with one
# thread, 30,000 with two, and 1,200 with two on cores that another program is using.
TINY_PARAMETERS = 1_000


@dataclass(frozen=True)
class TrainingPlan:
    """How a training runs on its machine.

    Attributes:
        device: what this process trains on.
        processes: how many train together.
        precision: Lightning's name of it.
        threads: of this process.
        batch_device: where training batches are augmented; None for the CPU.
        batches_per_step: how many batches a step of Lightning's takes, an optimizer step each.
        compiled_batch: the size of the batches whose loss is compiled; None for none.
        features: cached features of frozen layers, fed in place of images; None for images.
    """

    device: torch.device
    processes: int = 1
    precision: str = "32-true"
    threads: int = 1
    batch_device: torch.device | None = None
    batches_per_step: int = 1
    compiled_batch: int | None = None
    features: FeaturePlan | None = None

    def line(self) -> str:
        """Return what to print."""
        processes = f", {self.processes} processes" if self.processes > 1 else ""
        together = f", {self.batches_per_step} batches per step"
        return (
            f"plan: {self.precision} on {self.device}{processes}, {self.threads} "
            f"thread{'' if self.threads == 1 else 's'}"
            + together * (self.batches_per_step > 1)
            + ", compiled" * bool(self.compiled_batch)
            + ", cached features" * bool(self.features)
            + f", augmented on {self.batch_device}" * bool(self.batch_device)
        )


def make_plan(
    config: DictConfig,
    data: DrivingData,
    network: nn.Module,
    trainer: lightning.Trainer,
    console: Console,
) -> TrainingPlan:
    """Return the plan of a training; print what it does not do, and why.

    Args:
        data: loaded.
        network: with the weights that training begins with.
        trainer: Lightning's, which knows the devices and the processes.

    Raises:
        InputError: `trainer.compile` or `model.cache_features` has a value that cannot be, or a
            batch has fewer samples than there are processes to share it.
    """
    world = trainer.world_size
    if data.batch_size < world:
        raise InputError(
            f"data.batch_size={data.batch_size} is for all processes together, of which there are "
            f"{world} (trainer.devices); set it to {world} or more"
        )
    parameters = sum(p.numel() for p in network.parameters())
    device, precision = trainer.strategy.root_device, trainer.precision
    if device.type == "cpu" and "bf16" in precision and multiplies_bf16() is False:
        console.print(
            f"trainer.precision={precision}: this processor has no instructions for it, "
            "32-true trains twice to eight times as fast",
            highlight=False,
            markup=False,
        )
    batch_device = data.choose_batch_device(device, console)
    is_overhead = device.type != "cpu" or parameters < TINY_PARAMETERS
    compiled_batch = None
    if resolve_compile(config.trainer.get("compile", False), device, console):
        share = share_of(data.batch_size, trainer.global_rank, world)
        compiled_batch = share.stop - share.start
    return TrainingPlan(
        device=device,
        processes=world,
        precision=precision,
        threads=_threads(parameters, world),
        batch_device=batch_device,
        batches_per_step=GROUP if is_overhead and _may_step_together(trainer) else 1,
        compiled_batch=compiled_batch,
        features=plan_cached_features(config, network, data, device, console),
    )


def _threads(parameters: int, processes: int) -> int:
    if parameters < TINY_PARAMETERS:
        return 1
    told = os.environ.get("OMP_NUM_THREADS", "")
    return int(told) if told.isdigit() and int(told) else max(1, usable_cores() // processes)


def _may_step_together(trainer: lightning.Trainer) -> bool:
    """Whether nothing was asked for that Lightning does, or counts, step by step."""
    return (
        trainer.world_size == 1
        and trainer.accumulate_grad_batches == 1
        and not trainer.gradient_clip_val
        and trainer.precision in ("32-true", "bf16-mixed", "bf16-true")
        and trainer.limit_train_batches == 1.0
        and trainer.max_steps == -1
        and trainer.val_check_interval == 1.0
    )
