"""How a training is run as fast as its machine allows; what it learns does not depend on it."""

import os

import lightning
import torch
from omegaconf import DictConfig
from rich.console import Console

from datamodules.balance import share_of
from datamodules.cores import usable_cores
from datamodules.driving import DrivingData
from datamodules.errors import InputError
from zoo.training.compilation import resolve_compile
from zoo.training.host_settings import keep_freed_memory, multiplies_bf16
from zoo.training.steering_module import SteeringModule

# A step of so small a network costs less than two threads' meeting: 52,000 samples/s with one
# thread, 30,000 with two, and 1,200 with two on cores that another program is using.
TINY_PARAMETERS = 1_000
TOGETHER = 32  # batches to a step of Lightning's, whose own work takes as long as two of them


def set_pace(
    config: DictConfig,
    module: SteeringModule,
    data: DrivingData,
    trainer: lightning.Trainer,
    console: Console,
) -> None:
    """Choose memory, threads, layout, steps at a time and compilation for what will be trained.

    Raises:
        InputError: `trainer.compile` is not auto, true or false, or a batch has fewer samples than
            there are processes to share it.
    """
    if data.batch_size < trainer.world_size:
        raise InputError(
            f"data.batch_size={data.batch_size} is for all processes together, of which there are "
            f"{trainer.world_size} (trainer.devices); set it to {trainer.world_size} or more"
        )
    parameters = sum(p.numel() for p in module.network.parameters())
    device = trainer.strategy.root_device
    if device.type == "cpu" and "bf16" in trainer.precision and multiplies_bf16() is False:
        console.print(
            f"trainer.precision={trainer.precision}: this processor has no instructions for it, "
            "32-true trains twice to eight times as fast",
            highlight=False,
            markup=False,
        )
    keep_freed_memory()
    # With trainer.deterministic torch fills all memory that it takes, lest something be read there
    # before it is written: 4 to 7 % of PilotNet's step.
    torch.utils.deterministic.fill_uninitialized_memory = False
    torch.set_num_threads(_threads(parameters, trainer.world_size))
    # What the pictures come in; weights in another layout would be turned round at every step.
    module.network.to(memory_format=torch.channels_last)
    data.make_batches_on(device, console)
    if _may_step_together(trainer) and (device.type != "cpu" or parameters < TINY_PARAMETERS):
        data.batches_together = TOGETHER
    if resolve_compile(config.trainer.get("compile", False), device, console):
        share = share_of(data.batch_size, trainer.global_rank, trainer.world_size)
        module.compile_batches_of(share.stop - share.start, console)


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
