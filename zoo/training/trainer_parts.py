"""What Lightning sets on a Trainer from outside the class, so that its type lacks it."""

from lightning import Callback, Trainer
from lightning.pytorch.profilers import Profiler

from datamodules.run_data import RunData


def callbacks_of(trainer: Trainer) -> list[Callback]:
    """Return the callbacks of a trainer, to which more can be appended."""
    return trainer.callbacks  # type: ignore[attr-defined]


def profiler_of(trainer: Trainer) -> Profiler:
    """Return the profiler of a trainer, which may measure nothing."""
    return trainer.profiler  # type: ignore[attr-defined]


def is_trial(trainer: Trainer) -> bool:
    """Return whether a trainer only tries its code, with `trainer.fast_dev_run`."""
    return bool(trainer.fast_dev_run)  # type: ignore[attr-defined]


def data_of(trainer: Trainer) -> RunData:
    """Return the datamodule with which a trainer fits."""
    return trainer.datamodule  # type: ignore[attr-defined]
