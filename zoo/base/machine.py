"""Facts of this machine: its cores and processor, and which process listens on a port."""

import math
import os
import platform
from contextlib import suppress
from pathlib import Path


def usable_cores() -> int:
    """Return the cores that this process may use, by affinity and container quota."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:  # macOS and Windows
        cores = os.cpu_count() or 1
    return max(1, math.ceil(min(cores, _container_cores())))


def _container_cores() -> float:
    """Return the cores of a container's quota, of cgroups 2 or 1; infinity without one."""
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text(encoding="utf-8").split()
    except (OSError, ValueError):
        folder = Path("/sys/fs/cgroup/cpu")
        try:
            quota = (folder / "cpu.cfs_quota_us").read_text(encoding="utf-8").strip()
            period = (folder / "cpu.cfs_period_us").read_text(encoding="utf-8").strip()
        except OSError:
            return math.inf
    return math.inf if quota in ("max", "-1") else int(quota) / int(period)


def processor_name() -> str:
    """Return the name of the processor's model, or of its architecture where none is known."""
    with suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(": ")[1] for line in lines if line.startswith("model name"))
    return platform.processor() or platform.machine()


def port_holder(port: int) -> str | None:
    """Return the command and id of the process that listens on a TCP port of this machine.

    Returns:
        Both in one line; None if no process does, or if it belongs to another user.

    >>> port_holder(1) is None
    True
    """
    import psutil  # slow

    for process in psutil.process_iter():
        with suppress(psutil.Error):  # it has ended, or belongs to another user
            for connection in process.net_connections("tcp"):
                if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port:
                    return f"{' '.join(process.cmdline()).strip():.100} (process {process.pid})"
    return None
