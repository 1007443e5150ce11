"""Modules of drivezoo as child processes, which end when their parent ends, however it ends."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from zoo.base.errors import StoppedError

PARENT = "DRIVEZOO_PARENT"  # environment variable of a child: its parent's process id
LOOK_S = 0.5
GRACE_S = 5.0  # to close files after SIGTERM
# Flag of a child that Ctrl-C does not reach, and which can be stopped alone; Windows has it alone.
NEW_GROUP = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the words that run a module of drivezoo, see `zoo.base.module_start`."""
    # On Windows an environment's python.exe starts Python as a child, which has another process id.
    python = getattr(sys, "_base_executable" if sys.platform == "win32" else "executable")
    return [python, str(Path(__file__).with_name("module_start.py")), module, *arguments]


def child_environment() -> dict[str, str]:
    """Return the environment of a `module_command` that shall end with this process."""
    variables = {PARENT: str(os.getpid())}
    if sys.platform == "win32":  # so that Python knows the environment, as in `multiprocessing`
        variables["__PYVENV_LAUNCHER__"] = sys.executable
    return os.environ | variables


def start_module(module: str, *arguments: str, **options: Any) -> subprocess.Popen:
    """Start a module of drivezoo; `options` are those of `subprocess.Popen`.

    What it prints into a pipe or a file is UTF-8, also where a terminal has another encoding.
    """
    options |= {"creationflags": NEW_GROUP, "env": child_environment()}
    if "stdout" in options:
        options["env"]["PYTHONIOENCODING"] = "utf-8"
    return subprocess.Popen(module_command(module, *arguments), **options)


def run_module(module: str, *arguments: str, env: dict[str, str], **options: Any) -> int:
    """Run a module of drivezoo to its end; return its exit status.

    Args:
        module: module's name.
        *arguments: its arguments.
        env: further environment variables.
        options: those of `subprocess.Popen`.

    Raises:
        StoppedError: Ctrl-C; the child, which gets it too, has printed what it keeps.
    """
    words = module_command(module, *arguments)
    child = subprocess.Popen(words, env=child_environment() | env, **options)
    try:
        if (status := child.wait()) not in (130, -signal.SIGINT):
            return status
    except KeyboardInterrupt:  # where `subprocess.run` kills the child
        with suppress(subprocess.TimeoutExpired):
            child.wait(6 * GRACE_S)  # it may complete a checkpoint
        end_module(child)
    raise StoppedError("stopped; see above")


def end_module(process: subprocess.Popen, grace_s: float = GRACE_S) -> None:
    """End a child process, after some seconds also one that does not react to Ctrl-C."""
    with suppress(OSError):  # Windows, where this process has no terminal
        # As after Ctrl-C, so that it completes its files.
        process.send_signal(getattr(signal, "CTRL_BREAK_EVENT", signal.SIGINT))
    try:
        process.wait(grace_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def find_program(name: str) -> str | None:
    """Return the path of a program, never of one in the current folder, where Windows looks first.

    `subprocess` and, before Python 3.12, `shutil.which` would run what a stranger put there.
    """
    # Where the current folder is named, `which` does not add it as the first.
    path = shutil.which(name, path=os.pathsep.join([*os.get_exec_path(), os.curdir]))
    return path if path and Path(path).is_absolute() else None


def limit_resource(name: str, most_bytes: int) -> None:
    """Limit this process, which loads what a stranger made; Windows has no such limits.

    Args:
        name: limit of the module `resource`, such as RLIMIT_DATA, the memory.
        most_bytes: limit, unless the system's own is lower.
    """
    if sys.platform != "win32":
        import resource

        with suppress(ValueError):
            resource.setrlimit(getattr(resource, name), (most_bytes, most_bytes))


def end_with_parent() -> None:
    """End this process when the process ends that started it with `child_environment`."""
    parent = os.environ.pop(PARENT, "")  # not for this process's own children
    if parent == str(os.getppid()):
        end_after(int(parent))
    elif parent:
        import psutil  # slow

        if not psutil.pid_exists(int(parent)):  # else a process between them kept the variable
            sys.exit(1)


def end_after(parent: int) -> None:
    """End this process when its parent, of this process id, has ended."""
    import threading  # late: most processes need none

    def wait_and_end() -> None:
        _wait_for_parent(parent)
        signal.raise_signal(signal.SIGTERM)
        time.sleep(GRACE_S)
        os._exit(1)

    threading.Thread(target=wait_and_end, daemon=True).start()


def _wait_for_parent(pid: int) -> None:
    if sys.platform == "win32":
        import _winapi

        with suppress(OSError):  # it has ended
            handle = _winapi.OpenProcess(_winapi.SYNCHRONIZE, False, pid)
            _winapi.WaitForSingleObject(handle, _winapi.INFINITE)
    else:
        while os.getppid() == pid:
            time.sleep(LOOK_S)
