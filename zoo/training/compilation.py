"""Compile a training step (`trainer.compile`), or go on without.

`auto` does not. Seven tenths of PilotNet's step on a CPU are convolutions, which a compiler leaves
to the same library. Against the plain step, both with memory kept, channels last and the dropout of
`zoo.models.layers`, the compiled one gave 10 % more samples a second on four threads, and 6 % in
bf16, after 20 to 45 s of compiling: a run of five minutes would gain nothing. With torch's dropout
it took two thirds more, since torch draws within the compiled loops.
"""

import os
import shutil
from collections.abc import Callable

import torch
from rich.console import Console

from datamodules.errors import InputError


def resolve_compile(setting: object, device: torch.device, console: Console) -> bool:
    """Whether to compile; not on a CPU without a C++ compiler, which is said in a line.

    Raises:
        InputError: the setting is not auto, true or false.
    """
    if setting not in ("auto", True, False):
        raise InputError(f"trainer.compile={setting} is not auto, true or false")
    if setting is not True:
        return False
    if device.type == "cpu" and not find_compiler():
        console.print(
            "not compiled, for want of a C++ compiler (Debian, Ubuntu: apt install g++)",
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
