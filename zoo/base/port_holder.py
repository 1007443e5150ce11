"""Search for the process that listens on a port."""

from contextlib import suppress

import psutil


def port_holder(port: int) -> str | None:
    """Return the command and id of the process that listens on a TCP port of this machine.

    Returns:
        Both in one line; None if no process does, or if it belongs to another user.

    >>> port_holder(1) is None
    True
    """
    for process in psutil.process_iter():
        with suppress(psutil.Error):  # it has ended, or belongs to another user
            for connection in process.net_connections("tcp"):
                if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port:
                    return f"{' '.join(process.cmdline()).strip():.100} (process {process.pid})"
    return None
