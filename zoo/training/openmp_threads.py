"""The OpenMP wait policy during training: spin on a quiet machine, sleep on a busy machine.

A spinning thread continues at once; a sleeping thread has to be woken, hundreds of times a step.
But on a core that another program needs, a spinning thread delays that program, and all threads
wait for the thread that lost its core. OpenMP fixes the policy when torch is imported. GNU OpenMP,
which torch uses on Linux, stops spinning while it has more threads than there are cores: a team of
idle threads switches spinning off at any time.

LeNet trained on 11,000 samples/s with threads that spin and 5,200 with threads that sleep, on four
quiet cores (docs/performance.md). On two cores that other programs used all the time, it trained
2.2 and 6.1 times as fast with this watch as with GNU OpenMP's own policy (two runs, in turns).
"""

import ctypes
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

STAT, MAPS = Path("/proc/stat"), Path("/proc/self/maps")
LOOK_EVERY_S = 0.5
QUIET_LOOKS = 2  # quiet measurements in a row before threads spin
SPARE_CORES = 0.7  # cores of our threads that other programs may use on a quiet machine


def choose_waiting() -> None:
    """Let threads sleep where `spinning_while_quiet` cannot switch; call before importing torch.

    An existing OMP_WAIT_POLICY or GOMP_SPINCOUNT is kept.
    """
    if not _was_chosen():
        # Intel's and LLVM's OpenMP use it; GNU's does not.
        os.environ.setdefault("KMP_BLOCKTIME", "0")
        if not STAT.exists():
            os.environ["OMP_WAIT_POLICY"] = "PASSIVE"


def _was_chosen() -> bool:
    return "OMP_WAIT_POLICY" in os.environ or "GOMP_SPINCOUNT" in os.environ


@contextmanager
def spinning_while_quiet(threads: int) -> Iterator[None]:
    """Make threads spin while other programs leave their cores free, and sleep otherwise.

    Nothing changes with one thread, without GNU OpenMP, or where the user set the wait policy.
    Results never change.
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
    """Keep an idle team in the first second and while other programs are busy."""
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
    """A team of idle OpenMP threads, until `end`."""

    def __init__(self, openmp: ctypes.CDLL, count: int) -> None:
        self._openmp, self._count = openmp, count
        self._there, self._over = threading.Event(), threading.Event()
        # A team belongs to the thread that started it, and ends with that thread.
        self._thread = threading.Thread(target=self._hold, daemon=True)
        self._thread.start()
        self._there.wait()

    def _hold(self) -> None:
        # Each thread of the team calls free(NULL), which does nothing.
        nothing = ctypes.CDLL(None).free
        self._openmp.GOMP_parallel(nothing, None, ctypes.c_uint(self._count), ctypes.c_uint(0))
        self._there.set()
        self._over.wait()

    def end(self) -> None:
        """End the team's threads."""
        self._over.set()
        self._thread.join()


def _usage() -> tuple[float, float, float]:
    """Return seconds by the clock, of this process, and of all programs on our cores."""
    if sys.platform != "linux":
        raise OSError(f"no {STAT} here")
    ours = {f"cpu{number}" for number in os.sched_getaffinity(0)}
    rows = (line.split() for line in STAT.read_text(encoding="utf-8").splitlines())
    # All columns up to steal, except idle and iowait.
    ticks = sum(sum(map(int, r[1:4])) + sum(map(int, r[6:9])) for r in rows if r[0] in ours)
    return time.perf_counter(), time.process_time(), ticks / os.sysconf("SC_CLK_TCK")


def _find_openmp() -> ctypes.CDLL | None:
    """Return GNU OpenMP if torch has loaded it, else None."""
    try:
        lines = MAPS.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
        # The sixth column is a path, which may have spaces.
        loaded = sorted({line.split(maxsplit=5)[-1] for line in lines if "libgomp" in line})
        # Other packages may have loaded another copy.
        torchs = [path for path in loaded if "/torch/" in path] or loaded
        return ctypes.CDLL(torchs[0]) if torchs else None
    # No such file on this system, or the library was replaced meanwhile.
    except (OSError, UnicodeError):  # ctypes cannot name a path that is not UTF-8
        return None
