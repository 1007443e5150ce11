"""Callbacks that stop a run during training, or remove or fill its disk."""

import shutil
import signal
from pathlib import Path

import lightning


class RemoveFolder(lightning.Callback):
    """A callback that removes the run's folder at the start of an epoch."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch == self.epoch:
            # Several times, since TensorBoard's thread still writes there.
            while Path(trainer.default_root_dir).exists():
                shutil.rmtree(trainer.default_root_dir, ignore_errors=True)


class LimitFiles(lightning.Callback):
    """A callback that limits the size of files: larger writes fail, as on a full disk."""

    def __init__(self, epoch: int, limit: int) -> None:
        self.epoch, self.limit = epoch, limit

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        import resource

        if trainer.current_epoch == self.epoch:
            _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.limit, hard))


class Interrupt(lightning.Callback):
    """A callback that raises KeyboardInterrupt, as Ctrl-C does, at the start of an epoch."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch == self.epoch:
            raise KeyboardInterrupt


class Terminate(lightning.Callback):
    """A callback that sends SIGTERM, as a scheduler does, at the end of an epoch."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch

    def on_train_epoch_end(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch == self.epoch:
            signal.raise_signal(signal.SIGTERM)
