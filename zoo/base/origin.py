"""Access control: only simulators and the driver's own page may send requests."""

import ipaddress
from collections.abc import Callable, Iterable
from urllib.parse import urlsplit

from zoo.base.notices import Notices

OWN_SITES = ("same-origin", "none")  # Sec-Fetch-Site of the own page, and of a typed address


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach a server that is bound to `host`.

    >>> is_loopback("localhost"), is_loopback("127.0.0.1"), is_loopback("127.example.org")
    (True, True, False)
    """
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class OriginGuard:
    """WSGI middleware that refuses requests that a page of another site makes a browser send.

    A simulator sends no Origin. A browser does, and it must be the Origin of the server's own page.
    For a plain image or link, a browser sends Sec-Fetch-Site instead: a link of another site may
    open the page, and nothing else. On loopback the Host must be a loopback name, too, since
    another site can point its own name to this address (DNS rebinding).

    Args:
        exposed: whether other machines may reach the server, under any name.
        notices: log of refused requests.
    """

    def __init__(self, exposed: bool, notices: Notices) -> None:
        self.exposed, self.notices = exposed, notices

    def allows(self, origin: str | None, environ: dict) -> bool:
        """Return whether a request is answered.

        Args:
            origin: header Origin; None without one.
            environ: WSGI environment of the request.
        """
        host = environ.get("HTTP_HOST")
        if origin and origin not in (f"http://{host}", f"https://{host}"):
            return False
        if environ.get("HTTP_SEC_FETCH_SITE", "none") not in OWN_SITES:
            is_link = environ.get("HTTP_SEC_FETCH_MODE") == "navigate"
            if not is_link or environ.get("PATH_INFO") != "/":
                return False
        if self.exposed:
            return True
        return host is None or is_loopback(urlsplit(f"//{host}").hostname or "")

    def __call__(self, app: Callable) -> Callable:
        """Return a WSGI application that answers only allowed requests."""

        def guarded(environ: dict, start_response: Callable) -> Iterable[bytes]:
            origin = environ.get("HTTP_ORIGIN")
            try:
                allowed = self.allows(origin, environ)
            except ValueError:  # the Host is malformed
                allowed = False
            if allowed:
                return app(environ, start_response)
            who = origin or environ.get("HTTP_HOST", "no host")
            self.notices.report("a request of another site's page was refused", f"{who:.80}")
            start_response("403 Forbidden", [("Content-Type", "text/plain")])
            return [b"refused: this server answers only simulators and its own page\n"]

        return guarded
