"""A process that imports the commands' libraries once, and forks a process for each command.

Importing torch, Lightning and albumentations takes longer than most commands of the tests. A fork
has its own exit status, current folder, environment and output, as `python -m` has. Tests of the
start itself (imports, threads, Ctrl-C during imports) use `commands.command` instead.
"""

import atexit
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from importlib import import_module
from pathlib import Path

from tests.kept_compositions import keep_files
from tests.spared_work import spare_work
from zoo.base import process_pool
from zoo.base.compose import compose_config

# Not the commands themselves: these must run as `__main__`.
IMPORTED = (
    "albumentations",
    "hydra._internal.utils",
    "jinja2",
    "lightning",
    "matplotlib.backends.backend_agg",
    "matplotlib.pyplot",
    "torch.utils.tensorboard",
    "zoo.server.server",
    "zoo.training.run",
)


class ForkedCommands:
    """A process that forks commands and waits for them; it ends with this process."""

    def __init__(self, environment: dict[str, str], code: Path) -> None:
        words = [sys.executable, "-m", __name__]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen(words, env=environment, cwd=code, **pipes)

    def start(
        self,
        arguments: list[str],
        cwd: Path,
        environment: dict[str, str],
        timeout_s: int,
        output: Path,
        errors: Path,
    ) -> int:
        """Start `python -m ARGUMENTS` and return its process id; its output goes to the two files.

        A first argument that ends with `.py` is a script: `python ARGUMENTS`.
        """
        return self._ask(arguments, str(cwd), environment, timeout_s, str(output), str(errors))

    def wait(self, pid: int) -> int:
        """Return the exit status of a process at its end."""
        return self._ask(pid)

    def _ask(self, *request: object) -> int:
        print(json.dumps(request), file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())


class ForkedProcess:
    """A running `python -m ARGUMENTS`, with the part of Popen's interface that tests use.

    Attributes:
        stdout: text that the process prints, errors included.
        returncode: exit status; None before its end is known.
    """

    def __init__(
        self,
        commands: ForkedCommands,
        arguments: list[str],
        cwd: Path,
        environment: dict[str, str],
        timeout_s: int = 300,
    ) -> None:
        self._commands = commands
        self.returncode: int | None = None
        with tempfile.TemporaryDirectory() as folder:
            pipe = Path(folder, "output")
            os.mkfifo(pipe)
            self.pid = commands.start(arguments, cwd, environment, timeout_s, pipe, pipe)
            self.stdout = pipe.open()  # waits until the process opens its end

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill the process."""
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float) -> tuple[str, None]:
        """Return what the process still prints until its end.

        Raises:
            TimeoutExpired: it runs for longer than `timeout` seconds.
        """
        late = threading.Timer(timeout, self.kill)
        late.start()
        printed = self.stdout.read()
        if self.wait() == -signal.SIGKILL:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        late.cancel()
        return printed, None

    def poll(self) -> int | None:
        """Return the exit status, or None while the process runs."""
        state = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()[0]
        return self.wait() if state == "Z" else None

    def wait(self) -> int:
        """Return the exit status at the end of the process."""
        if self.returncode is None:
            self.returncode = self._commands.wait(self.pid)
            self.stdout.close()
        return self.returncode


def serve() -> None:
    """Fork a process or wait for one at each request; return in forks, ready for the command."""
    for module in IMPORTED:
        import_module(module)
    process_pool.usable_cores = lambda: 1  # no process imports torch for a drive of 10 m
    keep_files()
    compose_config([])  # each fork has these files
    spare_work()  # else each fork's collections copy all pages of what was imported
    for line in sys.stdin:
        request = json.loads(line)
        if len(request) == 1:
            print(os.waitstatus_to_exitcode(os.waitpid(request[0], 0)[1]), flush=True)
            continue
        pid = os.fork()
        if pid == 0:
            become(*request)
            return
        print(pid, flush=True)
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
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(os.open(output, os.O_WRONLY), 1)
    os.dup2(1 if errors == output else os.open(errors, os.O_WRONLY), 2)
    # The old ones may believe that they write to a file.
    sys.stdout = os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = arguments
    sys.orig_argv = [sys.executable, "-m", *arguments]
    sys.path[0] = cwd
    signal.alarm(timeout_s)


def run_and_exit(module: str) -> None:
    """Run a module or a script as Python does, then end without taking apart what `serve` imported.

    Taking apart torch and the rest takes longer than most commands.
    """
    status: object = 0
    try:
        if module.endswith(".py"):
            sys.path[0] = str(Path(module).parent)
            runpy.run_path(module, run_name="__main__")
        else:
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
