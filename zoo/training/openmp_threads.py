"""How threads wait for each other in a training's steps: they spin on a quiet machine, else sleep.

A thread that spins goes on at once when it may; one that sleeps has to be woken, hundreds of times
a step. But on a core that another program wants, a thread that spins holds that program up, and
all wait for a thread that has lost its core. OpenMP decides it once, when torch is imported. GNU's,
which torch has on Linux, gives up spinning at once while it has more threads than there are cores,
though: a team of idle ones makes it so at any time.
"""

import ctypes
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

STAT, MAPS = Path("/proc/stat"), Path("/proc/self/maps")
LOOK_EVERY_S = 0.5
QUIET_LOOKS = 2  # in a row, before threads spin
SPARE_CORES = 0.7  # that others may use of those which our threads take


def choose_waiting() -> None:
    """Let threads sleep where `spinning_while_quiet` can't choose later. Before torch is imported.

    Who has said how threads wait is heeded.
    """
    if not _was_chosen():
        os.environ.setdefault("KMP_BLOCKTIME", "0")  # Intel's and LLVM's; GNU's does not know it
        if not STAT.exists():
            os.environ["OMP_WAIT_POLICY"] = "PASSIVE"


def _was_chosen() -> bool:
    return "OMP_WAIT_POLICY" in os.environ or "GOMP_SPINCOUNT" in os.environ


@contextmanager
def spinning_while_quiet(threads: int) -> Iterator[None]:
    """Within it, so many threads spin while other programs leave them their cores, or else sleep.

    With one thread, without GNU's OpenMP, or where the user has said how threads wait, nothing is
    changed. What is computed never is.
    """
    openmp = _find_openmp()
    if threads < 2 or openmp is None or not os.access(STAT, os.R_OK) or _was_chosen():
        yield
        return
    over = threading.Event()
    watch = threading.Thread(target=_watch, args=(openmp, threads, over), daemon=True)
    watch.start()
    try:
        yield
    finally:
        over.set()
        watch.join()


def _watch(openmp: ctypes.CDLL, threads: int, over: threading.Event) -> None:
    """Keep an idle team while others are busy, and for the first second, until that is known."""
    cores = openmp.omp_get_num_procs()
    team: IdleTeam | None = IdleTeam(openmp, cores)
    before, quiet_looks = _usage(), 0
    while not over.wait(LOOK_EVERY_S):
        now = _usage()
        seconds, own_s, busy_s = (b - a for a, b in zip(before, now, strict=True))
        before, others = now, (busy_s - own_s) / seconds
        quiet_looks = quiet_looks + 1 if others + threads <= cores + SPARE_CORES else 0
        if team is None and not quiet_looks:
            team = IdleTeam(openmp, cores)
        elif team is not None and quiet_looks >= QUIET_LOOKS:
            team.end()
            team = None
    if team is not None:
        team.end()


class IdleTeam:
    """So many threads of OpenMP's that do nothing but be there, until `end`."""

    def __init__(self, openmp: ctypes.CDLL, count: int) -> None:
        self._openmp, self._count = openmp, count
        self._there, self._over = threading.Event(), threading.Event()
        # A team belongs to the thread that has called for it, and ends with that.
        self._thread = threading.Thread(target=self._hold, daemon=True)
        self._thread.start()
        self._there.wait()

    def _hold(self) -> None:
        # What every thread of the team calls: free(NULL), which does nothing.
        nothing = ctypes.CDLL(None).free
        self._openmp.GOMP_parallel(nothing, None, ctypes.c_uint(self._count), ctypes.c_uint(0))
        self._there.set()
        self._over.wait()

    def end(self) -> None:
        self._over.set()
        self._thread.join()


def _usage() -> tuple[float, float, float]:
    """Seconds by the clock, of this process's threads, and of all that ran on our cores."""
    ours = {f"cpu{number}" for number in os.sched_getaffinity(0)}
    rows = (line.split() for line in STAT.read_text().splitlines())
    # All columns but idle and iowait, up to what other virtual machines stole.
    ticks = sum(sum(map(int, r[1:4])) + sum(map(int, r[6:9])) for r in rows if r[0] in ours)
    return time.perf_counter(), time.process_time(), ticks / os.sysconf("SC_CLK_TCK")


def _find_openmp() -> ctypes.CDLL | None:
    """GNU's OpenMP, if that is what torch has loaded."""
    try:
        lines = MAPS.read_text().splitlines()
        # The sixth column is a path, which may have spaces.
        found = sorted({line.split(maxsplit=5)[-1] for line in lines if "libgomp" in line})
        # Other packages may have brought their own.
        torchs = [path for path in found if "/torch/" in path] or found
        return ctypes.CDLL(torchs[0]) if torchs else None
    except OSError:  # of a system that has no such file, or a library that was replaced since
        return None
