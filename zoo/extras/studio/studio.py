"""`drivezoo studio`: one page to drive, record, train and watch."""

import contextlib
import socket
from typing import Annotated
from urllib.parse import quote

from pydantic import Field

from zoo.base.command import command
from zoo.base.errors import UsageError
from zoo.base.origin import is_loopback

LEAST_KEY = 8  # characters
EVERY = "0.0.0.0"  # host that stands for all addresses of this machine


@command(parts=False)
def studio(
    *,
    port: Annotated[int, Field(ge=0, le=65535)] = 4572,
    host: str = "127.0.0.1",
    key: str | None = None,
) -> None:
    """Drive, record, train and watch networks on one page.

    Prints the page's address. Each step on the page is a command, and the page shows its line.
    Ctrl-C ends the studio, and stops a training as Ctrl-C stops it.

    Args:
        port: TCP port of the page; 0: a free one.
        host: address to listen on; one that other machines reach needs key=.
        key: word without which nobody can use the page; at least 8 characters.

    Raises:
        UsageError: other machines could use the page without a key.
        InputError: the host is no address of this machine, or the port is in use.
    """
    if not is_loopback(host) and len(key or "") < LEAST_KEY:
        raise UsageError(
            f"host={host}: other machines could use the page; add key=WORD of {LEAST_KEY} or more "
            "characters"
        )
    from zoo.base.page_server import PageServer
    from zoo.extras.studio.studio_page import MOST_UPLOAD, StudioPage

    page = StudioPage(key)
    with PageServer(port, page, host, MOST_UPLOAD) as server:
        name = socket.gethostname() if host == EVERY else server.server_name
        address = f"http://{name}:{server.server_port}{f'/?token={quote(key)}' if key else ''}"
        if not is_loopback(host):
            print("warning: who has the key can use this account's files and processor")
        with contextlib.suppress(KeyboardInterrupt):
            print(f"open {address} in a browser; Ctrl-C ends the studio", flush=True)
            server.serve_forever()
        page.close()


if __name__ == "__main__":
    studio.run()
