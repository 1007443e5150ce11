"""`trainer.compile`: the loss of a batch, compiled by torch."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.terminal import print_line

if TYPE_CHECKING:
    from zoo.training.batch_step import BatchLoss


def compiles(setting: object) -> bool:
    """Return whether to compile the step.

    Seven tenths of PilotNet's step on a CPU are convolutions, which use the same library with and
    without compilation. On four threads the compiled step trained 10 % more samples per second than
    the plain step, and 6 % more in bf16, after 20 to 45 s of compilation: it does not pay in a run
    of five minutes. Both steps kept freed memory and used channels last and `zoo.models.layers`'
    dropout.

    Raises:
        InputError: the setting is not true or false; `auto`, of older configs, is false.
    """
    if setting not in ("auto", True, False):
        raise InputError(f"trainer.compile={setting} is not true or false")
    return setting is True


def compiled_loss(loss: "BatchLoss", size: int, console: Console) -> "BatchLoss":
    """Return the loss of a batch, compiled for batches of `size` samples alone."""
    compiled = compile_step(loss, console)
    return lambda batch: (compiled if len(batch["images"]) == size else loss)(batch)


def compile_step(step: Callable, console: Console) -> Callable:
    """Return `step`, compiled at its first call; print why where compilation fails."""
    chosen: Callable | None = None

    def run(*arguments: object) -> object:
        nonlocal chosen
        if chosen:
            return chosen(*arguments)
        try:
            compiled = torch.compile(step, dynamic=False)
            result, chosen = compiled(*arguments), compiled
        except InputError:
            raise
        except Exception as error:  # any error, such as no C++ compiler: train without compilation
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            print_line(console, f"torch.compile disabled: {reason}")
            result, chosen = step(*arguments), step
        return result

    return run
