"""Compile a training step with torch.compile (`trainer.compile=true`).

Seven tenths of PilotNet's step on a CPU are convolutions, which use the same library with and
without compilation. On four threads the compiled step trained 10 % more samples per second than the
plain step, and 6 % more in bf16, after 20 to 45 s of compilation: it does not pay in a run of five
minutes. Both steps kept freed memory and used channels last and `zoo.models.layers`' dropout.
"""

import os
import shutil
from collections.abc import Callable

import torch
from rich.console import Console

from zoo.base.errors import InputError


def resolve_compile(setting: object, device: torch.device, console: Console) -> bool:
    """Return whether to compile; on a CPU without a C++ compiler print why not.

    Raises:
        InputError: the setting is not true or false; `auto`, of older configs, is false.
    """
    if setting not in ("auto", True, False):
        raise InputError(f"trainer.compile={setting} is not true or false")
    if setting is not True:
        return False
    if device.type == "cpu" and not find_compiler():
        console.print(
            "torch.compile disabled: no C++ compiler found; install one (Debian, Ubuntu: "
            "apt install g++)",
            highlight=False,
        )
        return False
    return True


def find_compiler() -> str | None:
    """Return the path of the C++ compiler that torch would use; None without one."""
    named = os.environ.get("CXX")
    return shutil.which(named) if named else next(filter(None, map(shutil.which, _COMPILERS)), None)


_COMPILERS = ("g++", "clang++", "c++")


def compile_step(step: Callable, console: Console) -> Callable:
    """Return `step`, compiled at its first call; print why where compilation fails."""
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
        except Exception as error:  # any error: training continues without compilation
            reason = str(error).strip().splitlines()[0][:200] if str(error).strip() else error
            console.print(f"torch.compile disabled: {reason}", highlight=False, markup=False)
            compiled = step
            result = step(*arguments)
        works = True
        return result

    return run
