"""Whether a training step is compiled (`trainer.compile`), and its speed without harm elsewhere."""

import os
import shutil
from collections.abc import Callable

import torch
from rich.console import Console

from datamodules.errors import InputError

# To compile takes half a minute to one and a half; it has to be won back, and more.
WORTH_SAMPLES = 400_000
# Smaller networks gain nothing: their time is not spent in layers.
WORTH_PARAMETERS = 1_000


def resolve_compile(
    setting: object, device: torch.device, parameters: int, samples: int, console: Console
) -> bool:
    """Whether to compile, of `auto`, true or false.

    `auto` compiles for a CPU, where a run of so many `samples` in all its epochs wins the time
    back. It depends on nothing else but the compiler, so that a run that goes on does as before.

    Raises:
        InputError: another setting.
    """
    if setting not in ("auto", True, False):
        raise InputError(f"trainer.compile={setting} is not auto, true or false")
    if setting is False:
        return False
    pays = samples >= WORTH_SAMPLES and parameters >= WORTH_PARAMETERS and device.type == "cpu"
    if setting == "auto" and not pays:
        return False
    if device.type == "cpu" and not find_compiler():
        console.print(
            "not compiled, for want of a C++ compiler (Debian, Ubuntu: apt install g++): trains "
            "a little slower",
            highlight=False,
        )
        return False
    return True


def find_compiler() -> str | None:
    """The C++ compiler that torch would take."""
    named = os.environ.get("CXX")
    return shutil.which(named) if named else next(filter(None, map(shutil.which, _COMPILERS)), None)


_COMPILERS = ("g++", "clang++", "c++")


def compile_step(step: Callable, console: Console) -> Callable:
    """`step` compiled at its first call; as it was, with a line, where that fails."""
    compiled = torch.compile(step, dynamic=False)
    works = False

    def run(*arguments: object) -> object:
        nonlocal compiled, works
        if works:
            return compiled(*arguments)
        try:
            result = compiled(*arguments)
        except InputError:
            raise
        except Exception as error:  # whatever a compiler says, training can go on
            reason = str(error).strip().splitlines()[0][:200] if str(error).strip() else error
            console.print(f"not compiled: {reason}", highlight=False, markup=False)
            compiled = step
            result = step(*arguments)
        works = True
        return result

    return run
