"""Which process holds a port."""

from contextlib import suppress

import psutil


def port_holder(port: int) -> str | None:
    """Return the command and the number of the process that listens on a TCP port of this machine.

    None where there is none, or it is another user's.

    >>> port_holder(1) is None
    True
    """
    for process in psutil.process_iter():
        with suppress(psutil.Error):  # it has ended, or is another user's
            for one in process.net_connections("tcp"):
                if one.status == psutil.CONN_LISTEN and one.laddr.port == port:
                    return f"{' '.join(process.cmdline()).strip():.100} (process {process.pid})"
    return None
