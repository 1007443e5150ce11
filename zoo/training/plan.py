"""A training's plan: everything that depends on the machine, decided once.

It does not change what a network learns.
"""

import os
from dataclasses import dataclass

import lightning
import torch
from lightning.pytorch.callbacks import EarlyStopping, LearningRateMonitor, ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from omegaconf import DictConfig
from rich.console import Console
from torch import nn

from datamodules.balance import share_of
from datamodules.batches import GROUP
from datamodules.features import FeaturePlan
from datamodules.run_data import RunData
from zoo.base.errors import InputError
from zoo.base.machine import usable_cores
from zoo.base.terminal import counted, print_line
from zoo.training.compiled_loss import compiles
from zoo.training.frozen_layers import plan_cached_features
from zoo.training.host_settings import multiplies_bf16
from zoo.training.run_module import callbacks_of
from zoo.training.steering_module import OWN

GROUP_IMAGES = 8192  # of a group on a GPU: 24 ms of PilotNet on an H100, 320 MB of images

# Below this, a step costs less than synchronizing two threads: 52,000 samples/s with one thread,
# 30,000 with two, and 1,200 with two on cores that another program uses.
TINY_PARAMETERS = 1_000


@dataclass(frozen=True)
class TrainingPlan:
    """How a training runs on its machine.

    Attributes:
        device: device of this process.
        processes: number of processes that train together.
        precision: precision by Lightning's name, such as `bf16-mixed`.
        threads: number of threads of this process.
        batch_device: device that augments training batches; None for the CPU.
        batches_per_step: batches in a step of Lightning's, an optimizer step each.
        compiled_batch: size of the batches whose loss is compiled; None without compilation.
        captured_batch: size of the batches whose steps are replayed as a CUDA graph; None for none.
        features: cached features of frozen layers, fed in place of images; None for images.
    """

    device: torch.device
    processes: int = 1
    precision: str = "32-true"
    threads: int = 1
    batch_device: torch.device | None = None
    batches_per_step: int = 1
    compiled_batch: int | None = None
    captured_batch: int | None = None
    features: FeaturePlan | None = None

    def line(self) -> str:
        """Return the line to print."""
        processes = f", {self.processes} processes" if self.processes > 1 else ""
        return (
            f"plan: {self.precision} on {self.device}{processes}, {counted(self.threads, 'thread')}"
            + f", {self.batches_per_step} batches per step" * (self.batches_per_step > 1)
            + ", compiled" * bool(self.compiled_batch)
            + ", as a CUDA graph" * bool(self.captured_batch)
            + ", cached features" * bool(self.features)
            + f", augmented on {self.batch_device}" * bool(self.batch_device)
        )


def make_plan(
    config: DictConfig,
    data: RunData,
    network: nn.Module,
    trainer: lightning.Trainer,
    console: Console,
) -> TrainingPlan:
    """Return the plan of a training; print which settings have no effect, and why.

    Args:
        config: experiment's config.
        data: loaded data.
        network: network with the weights that training starts from.
        trainer: Lightning's trainer, which knows devices and processes.
        console: console for these lines.

    Raises:
        InputError: `trainer.compile`, `trainer.group_batches` or `model.cache_features` is wrong,
            or a batch has fewer samples than there are processes.
    """
    world = trainer.world_size
    if data.batch_size < world:
        raise InputError(
            f"data.batch_size={data.batch_size} is shared by {world} processes (trainer.devices); "
            f"set it to {world} or more"
        )
    parameters = sum(p.numel() for p in network.parameters())
    device, precision = trainer.strategy.root_device, trainer.precision
    if device.type == "cpu" and "bf16" in precision and multiplies_bf16() is False:
        print_line(
            console,
            f"trainer.precision={precision}: this processor has no instructions for it; "
            "trainer.precision=32-true trains two to eight times as fast",
        )
    batch_device = data.choose_batch_device(device, console)
    grouped = config.trainer.get("group_batches", True)
    if not isinstance(grouped, bool):
        raise InputError(f"trainer.group_batches={grouped} is not true or false")
    is_own = (config.get("module") or {}).get("_target_", OWN) == OWN
    is_overhead = device.type != "cpu" or parameters < TINY_PARAMETERS
    compiled_batch = None
    if compiles(config.trainer.get("compile", False)) and is_own:
        share = share_of(data.batch_size, trainer.global_rank, world)
        compiled_batch = share.stop - share.start
    # Windows take more memory: a group has about as many images as one of single frames.
    group, least = GROUP // data.windows.sequence, 1
    if device.type == "cuda":
        group, least = GROUP_IMAGES // (data.batch_size * data.windows.sequence), 2
    threads = _threads(parameters, world)
    may_group = is_overhead and grouped and is_own and _may_group(config, trainer)
    return TrainingPlan(
        device=device,
        processes=world,
        precision=precision,
        threads=threads,
        batch_device=batch_device,
        batches_per_step=max(least, group) if may_group else 1,
        compiled_batch=compiled_batch,
        captured_batch=data.batch_size if may_group and device.type == "cuda" else None,
        features=plan_cached_features(config, network, data, device, threads, console),
    )


def _threads(parameters: int, processes: int) -> int:
    # Slurm may leave all cores of a node to each task.
    wanted = os.environ.get("OMP_NUM_THREADS") or os.environ.get("SLURM_CPUS_PER_TASK", "")
    cores = int(wanted) if wanted.isdigit() else usable_cores() // processes
    return 1 if parameters < TINY_PARAMETERS else max(1, cores)


def _takes_groups(callback: lightning.Callback) -> bool:
    """Return whether a callback never looks at batches or steps.

    Ours do not, nor the default ones, nor a user's with `takes_groups = True`.
    """
    if type(callback) is LearningRateMonitor:
        return callback.logging_interval == "epoch"
    says_so = getattr(callback, "takes_groups", False) is True
    is_ours = type(callback).__module__.startswith("zoo.")
    # Of a ModelCheckpoint by its keys, see `_saves_by_epoch`.
    return says_so or is_ours or type(callback) in (EarlyStopping, ModelCheckpoint)


def _saves_by_epoch(config: DictConfig) -> bool:
    """Return whether no checkpoint is saved after a number of steps or a time."""
    within = ("every_n_train_steps", "train_time_interval")
    callbacks = [settings for settings in (config.callbacks or {}).values() if settings]
    return not any(settings.get(key) for settings in callbacks for key in within)


def _may_group(config: DictConfig, trainer: lightning.Trainer) -> bool:
    """Return whether no setting, callback or logger needs Lightning to see every optimizer step."""
    return (
        _saves_by_epoch(config)
        and all(map(_takes_groups, callbacks_of(trainer)))
        and {type(logger) for logger in trainer.loggers} <= {CSVLogger, TensorBoardLogger}
        and trainer.world_size == 1
        and trainer.accumulate_grad_batches == 1
        and not trainer.gradient_clip_val
        and trainer.precision in ("32-true", "bf16-mixed", "bf16-true")
        and trainer.limit_train_batches == 1.0
        and trainer.max_steps == -1
        and trainer.val_check_interval == 1.0
    )
