"""Commands that run as child processes, and end when their parent ends, however it ends."""

import os
import signal
import sys
import time
from collections.abc import Mapping

PARENT = "DRIVEZOO_PARENT"  # environment variable of a child: its parent's process id
LOOK_S = 0.5
GRACE_S = 5.0  # to close files after SIGTERM


def child_environment(more: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the environment of a `python -m zoo...` that shall end with this process."""
    return os.environ | dict(more or {}) | {PARENT: str(os.getpid())}


def end_with_parent() -> None:
    """End this process when the process ends that started it with `child_environment`."""
    parent = os.environ.pop(PARENT, "")  # not for this process's own children
    if not parent.isdecimal() or not _is_parent(int(parent)):
        return
    import threading  # late: most processes need none

    threading.Thread(target=_end_after, args=(int(parent),), daemon=True).start()


def _is_parent(pid: int) -> bool:
    """Return whether a process is this one's parent, or was and has ended since."""
    if sys.platform == "win32" or os.getppid() == pid:
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except OSError:
        pass
    return False  # a process between them kept the variable


def wait_for_parent(pid: int) -> None:
    """Return when this process's parent, whose process id is `pid`, has ended."""
    if sys.platform == "win32":
        import _winapi

        try:
            handle = _winapi.OpenProcess(_winapi.SYNCHRONIZE, False, pid)
        except OSError:  # it has ended
            return
        _winapi.WaitForSingleObject(handle, _winapi.INFINITE)
    else:
        while os.getppid() == pid:
            time.sleep(LOOK_S)


def _end_after(parent: int) -> None:
    wait_for_parent(parent)
    signal.raise_signal(signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(1)
