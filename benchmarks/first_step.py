"""A callback for `benchmarks/start.py`, which `drivezoo train` creates by its name."""

import os

import lightning


class EndAtFirstStep(lightning.Callback):
    """A callback that ends the process with success just before the first training step."""

    def on_train_batch_start(self, *_: object) -> None:
        os._exit(0)
