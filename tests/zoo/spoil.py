"""Callbacks that stop a run in the middle of its training, or take its disk away."""

import shutil
from pathlib import Path

import lightning


class RemoveFolder(lightning.Callback):
    """Removes the run's folder at the beginning of an epoch."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch == self.epoch:
            while Path(
                trainer.default_root_dir
            ).exists():  # TensorBoard's thread still writes there
                shutil.rmtree(trainer.default_root_dir, ignore_errors=True)


class LimitFiles(lightning.Callback):
    """Lets no file grow beyond some bytes: writes fail where they do on a full disk."""

    def __init__(self, epoch: int, limit: int) -> None:
        self.epoch, self.limit = epoch, limit

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        import resource

        if trainer.current_epoch == self.epoch:
            _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (self.limit, hard))


class FillDisk(lightning.Callback):
    """Fills the disk of the run's folder at the beginning of an epoch, but for its checkpoints."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch == self.epoch:
            try:
                with (Path(trainer.default_root_dir) / "filler").open("wb", buffering=0) as file:
                    while True:
                        file.write(bytes(4096))
            except OSError:
                return


class Interrupt(lightning.Callback):
    """Raises what Ctrl-C does at the beginning of an epoch."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch

    def on_train_epoch_start(self, trainer: lightning.Trainer, module: object) -> None:
        if trainer.current_epoch == self.epoch:
            raise KeyboardInterrupt
