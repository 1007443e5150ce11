"""Callbacks with which the parts about training follow `drivezoo train`'s own code."""

import os
import time
from multiprocessing.connection import Connection
from pathlib import Path

import lightning
import torch
from omegaconf import DictConfig


class EndAtFirstStep(lightning.Callback):
    """A callback that ends the process with success just before the first training step.

    `drivezoo train` creates it by its name.
    """

    def on_train_batch_start(self, *_: object) -> None:
        os._exit(0)


class EpochByEpoch(lightning.Callback):
    """A callback that trains on request and sends the samples per second of one epoch.

    The first epoch is not measured.
    """

    takes_groups = True  # as `drivezoo train` has them

    def __init__(self, pipe: Connection) -> None:
        self.pipe = pipe

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch == 1:
            self.pipe.send(None)
        if trainer.current_epoch and not self.pipe.recv():
            os._exit(0)
        self.samples, self.began = module.train_samples, time.perf_counter()

    def on_train_batch_end(self, trainer: lightning.Trainer, module: object, *_: object) -> None:
        if trainer.is_last_batch and torch.cuda.is_initialized():
            torch.cuda.synchronize()  # what was started is not yet done
        self.seconds = time.perf_counter() - self.began

    def on_train_epoch_end(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch:
            self.pipe.send((module.train_samples - self.samples) / self.seconds)


def train_by_turns(pipe: Connection, config: DictConfig, folder: Path) -> None:
    """Train with `drivezoo train`'s own code, an epoch at each request; discard its output."""
    from unittest.mock import patch

    from zoo.training import build, run

    made = build.build_trainer

    def with_turns(*arguments: object, **options: object) -> lightning.Trainer:
        trainer = made(*arguments, **options)
        trainer.callbacks.insert(0, EpochByEpoch(pipe))
        return trainer

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    with patch.object(build, "build_trainer", with_turns):
        run.run_experiment(config, folder)
