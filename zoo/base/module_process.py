"""A module of drivezoo in a child process, which can be ended as Ctrl-C does."""

import signal
import subprocess
import sys
from typing import Any

from zoo.base.child_process import child_environment
from zoo.base.module_start import module_command


def start_module(module: str, *arguments: str, **options: Any) -> subprocess.Popen:
    """Start a module of drivezoo; `options` are those of `subprocess.Popen`."""
    if sys.platform == "win32":  # which interrupts whole groups of processes
        options["creationflags"] = subprocess.CREATE_NEW_PROCESS_GROUP
    return subprocess.Popen(module_command(module, *arguments), env=child_environment(), **options)


def interrupt_module(process: subprocess.Popen) -> None:
    """Let a child process end as after Ctrl-C, so that it completes its files."""
    if sys.platform == "win32":  # which raises ValueError for SIGINT
        process.send_signal(signal.CTRL_BREAK_EVENT)
    else:
        process.send_signal(signal.SIGINT)
