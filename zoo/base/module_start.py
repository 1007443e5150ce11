"""Start of a module as `python -m` does it, without the current folder on the import path.

`python -m MODULE` imports the files of the current folder first. There may be a stranger's
`torch.py`, or a folder `zoo` of the user's own.
"""

import os
import signal
import sys
from pathlib import Path
from typing import Any

ROOT = str(Path(__file__).absolute().parents[2])
CLEAN_PATH = "import sys; sys.path[:] = filter(None, sys.path); "


def run_module(module: str, arguments: list[str]) -> None:
    """Run a module as the main program, with these arguments."""
    _leave_out_current_folder()
    from zoo.base.run_command import stop_in_one_line

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, stop_in_one_line)
    if sys.version_info < (3, 11):  # which does not know PYTHONSAFEPATH
        clean_spawned_processes()
    sys.argv[1:] = arguments
    import runpy

    runpy.run_module(module, run_name="__main__", alter_sys=True)


def _leave_out_current_folder() -> None:
    """Keep the current folder off the path of this process and of the processes that it starts."""
    sys.path[:] = [folder for folder in sys.path if folder]
    if ROOT not in sys.path:  # a checkout that is not installed
        sys.path.insert(0, ROOT)
        folders = filter(None, [os.environ.get("PYTHONPATH")])
        os.environ["PYTHONPATH"] = os.pathsep.join([ROOT, *folders])
    os.environ["PYTHONSAFEPATH"] = "1"
    # Windows then starts no program of the current folder, for a library, either.
    os.environ["NODEFAULTCURRENTDIRECTORYINEXEPATH"] = "1"


def clean_spawned_processes() -> None:
    """Keep the current folder off the path of processes that `multiprocessing` spawns."""
    from multiprocessing import spawn, util

    line, start = spawn.get_command_line, util.spawnv_passfds

    def clean(words: Any) -> list:
        at = words.index("-c") + 1
        return [*words[:at], CLEAN_PATH + words[at], *words[at + 1 :]]

    if os.name == "nt":
        spawn.get_command_line = lambda **keys: clean(line(**keys))
    else:  # the resource tracker, too, which has a line of its own
        util.spawnv_passfds = lambda path, args, passfds: start(path, clean(args), passfds)


if __name__ == "__main__":
    sys.path.pop(0)  # the folder of this file
    run_module(sys.argv[1], sys.argv[2:])
