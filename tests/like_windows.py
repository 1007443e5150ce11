"""A folder for PYTHONPATH with which Python lacks what it lacks on Windows, in all child processes.

It hides modules and functions, spawns processes, refuses to replace or remove a file that is open
here, to rename a folder with such a file or to open a folder, and reads and writes text in the
encodings of an English Windows. The names of system and paths stay those of this machine: paths
with backslashes are not emulated.
"""

import os
from pathlib import Path

SITE = """
import builtins, os, re, select, signal, sys, warnings

OURS = r"(datamodules|drivezoo|hydra_plugins|simulator|zoo)\\b"
HIDDEN = {"fcntl", "grp", "pwd", "resource", "termios"}
plain_import = builtins.__import__


def import_module(name, scope=None, *more, **options):
    # Only from our modules: psutil and others have parts of their own for Windows.
    if name in HIDDEN and re.match(OURS, (scope or {}).get("__name__", "")):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return plain_import(name, scope, *more, **options)


builtins.__import__ = import_module
LACKING = {
    os: "fork forkpty getuid geteuid getpgid killpg mkfifo pread pwrite sched_getaffinity setsid",
    signal: "pthread_kill pthread_sigmask",
    select: "poll epoll",
}
for module, names in LACKING.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)


def is_open(path):
    path = os.path.realpath(path)
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
        if any(line.rstrip().endswith(path) for line in maps):
            return True
    for one in os.listdir("/proc/self/fd"):
        try:
            if os.path.join(os.readlink("/proc/self/fd/" + one), "").startswith(path + "/"):
                return True
        except OSError:
            pass
    return False


def refusing(function, checked):
    def refuse(*paths, **options):
        caller = sys._getframe(1).f_globals["__name__"]
        for path in paths[:checked]:
            if not caller.startswith(("tempfile", "multiprocessing")) and is_open(path):
                raise PermissionError(13, "The process cannot access the file", os.fspath(path))
        return function(*paths, **options)

    return staticmethod(refuse)  # pathlib of Python 3.10 makes methods of functions


os.replace, os.rename = refusing(os.replace, 2), refusing(os.rename, 2)
os.unlink = os.remove = refusing(os.unlink, 1)
plain_open = os.open


def open_file(path, *options, **more):
    if os.path.isdir(path):
        raise PermissionError(13, "Permission denied", path)
    return plain_open(path, *options, **more)


os.open = staticmethod(open_file)

from multiprocessing import context  # after the changes above, which it looks at

context.DefaultContext.get_all_start_methods = lambda self: ["spawn"]
context._default_context._default_context = context._concrete_contexts["spawn"]
context._default_context._actual_context = None
for name in ("fork", "forkserver"):
    context._concrete_contexts.pop(name, None)

warnings.filterwarnings("ignore", category=EncodingWarning)
warnings.filterwarnings("error", category=EncodingWarning, module=OURS)
"""


def like_windows(folder: Path, variables: dict[str, str]) -> dict[str, str]:
    """Return environment variables for a process without what Windows lacks.

    Args:
        folder: new folder to write to.
        variables: environment to change.
    """
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(SITE, encoding="utf-8")
    return variables | {
        "PYTHONPATH": os.pathsep.join([str(folder), variables["PYTHONPATH"]]),
        "USERNAME": "student",
        "LC_ALL": "C",
        "PYTHONCOERCECLOCALE": "0",
        "PYTHONUTF8": "0",
        "PYTHONIOENCODING": "cp1252",
        "PYTHONWARNDEFAULTENCODING": "1",
    }
