"""Search for the process that listens on a port."""

import os
import shutil
import subprocess
from pathlib import Path

_LISTENS = "0A"


def port_holder(port: int) -> str | None:
    """Return the command and id of the process that listens on a TCP port of this machine.

    Returns:
        Both in one line; None if no process does, or if it belongs to another user.

    >>> port_holder(1) is None
    True
    """
    if Path("/proc/net/tcp").is_file():
        return _from_proc(port)
    return _from_lsof(port)


def _from_proc(port: int) -> str | None:
    inodes = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        try:
            lines = Path(table).read_text().splitlines()[1:]
        except OSError:
            continue
        for fields in map(str.split, lines):
            if fields[3] == _LISTENS and int(fields[1].rpartition(":")[2], 16) == port:
                inodes.add(f"socket:[{fields[9]}]")
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            if any(os.readlink(one) in inodes for one in (process / "fd").iterdir()):  # noqa: PTH115
                words = (process / "cmdline").read_bytes().decode("utf-8", "replace").split("\0")
                return f"{' '.join(words).strip():.100} (process {process.name})"
        except OSError:  # it has ended, or belongs to another user
            continue
    return None


def _from_lsof(port: int) -> str | None:
    lsof = shutil.which("lsof")
    if lsof is None:
        return None
    command = [lsof, "-nP", f"-iTCP:{port}", "-sTCP:LISTEN", "-Fpc"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    found = {line[:1]: line[1:] for line in result.stdout.splitlines()}
    return f"{found['c']} (process {found['p']})" if {"p", "c"} <= found.keys() else None
