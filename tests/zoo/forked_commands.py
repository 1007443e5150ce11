"""A process that imports the commands' libraries once, and forks a process for each command.

Importing torch, Lightning and albumentations takes longer than most commands of the tests. A fork
has its own exit status, current folder, environment and output, as `python -m` has. Tests of the
start itself (imports, threads, Ctrl-C during imports) use `commands.command` instead.
"""

import atexit
import gc
import json
import os
import runpy
import signal
import subprocess
import sys
import threading
import traceback
from importlib import import_module
from pathlib import Path

# Not the commands themselves: these must run as `__main__`.
IMPORTED = (
    "albumentations",
    "hydra._internal.utils",
    "lightning",
    "matplotlib.pyplot",
    "torch.utils.tensorboard",
    "zoo.training.run",
)


class ForkedCommands:
    """A process that runs one command at a time; it ends with this process."""

    def __init__(self, environment: dict[str, str], code: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=code,
        )

    def run(
        self,
        arguments: list[str],
        cwd: Path,
        environment: dict[str, str],
        timeout_s: int,
        output: Path,
        errors: Path,
    ) -> int:
        """Return the exit status of `python -m ARGUMENTS`; its output goes to the two files."""
        request = [arguments, str(cwd), environment, timeout_s, str(output), str(errors)]
        print(json.dumps(request), file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())


def serve() -> None:
    """Fork a process for each request; return in the fork, ready to run the command."""
    for module in IMPORTED:
        import_module(module)
    gc.freeze()  # else each fork's collections copy all pages of what was imported
    for request in sys.stdin:
        pid = os.fork()
        if pid == 0:
            become(*json.loads(request))
            return
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
    sys.exit()


def become(
    arguments: list[str],
    cwd: str,
    environment: dict[str, str],
    timeout_s: int,
    output: str,
    errors: str,
) -> None:
    """Give this process the state in which `python -m ARGUMENTS` starts."""
    for number, path, flags in (
        (0, os.devnull, os.O_RDONLY),
        (1, output, os.O_WRONLY),
        (2, errors, os.O_WRONLY),
    ):
        os.dup2(os.open(path, flags), number)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = arguments
    sys.orig_argv = [sys.executable, "-m", *arguments]
    sys.path[0] = cwd
    signal.alarm(timeout_s)


def run_and_exit(module: str) -> None:
    """Run a module as `python -m` does, then end without taking apart what `serve` imported.

    Taking apart torch and the rest takes longer than most commands.
    """
    status: object = 0
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as error:
        status = error.code
    except BaseException:
        traceback.print_exc()
        status = 1
    if not isinstance(status, int | None):
        print(status, file=sys.stderr)
        status = 1
    threading._shutdown()
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:
        status = 120  # as Python ends where its output cannot be written
    os._exit(status or 0)


if __name__ == "__main__":
    serve()
    run_and_exit(sys.argv[0])
