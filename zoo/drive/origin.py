"""Who may come in: simulators, and browsers that show our own page."""

import ipaddress
from collections.abc import Callable, Iterable
from urllib.parse import urlsplit

from zoo.drive.notices import Notices

OWN_SITES = ("same-origin", "none")  # Sec-Fetch-Site of our own page, and of a typed address


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a server that is bound to `host`.

    >>> is_loopback("localhost"), is_loopback("127.0.0.1"), is_loopback("127.example.org")
    (True, True, False)
    """
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class OriginGuard:
    """A WSGI middleware that refuses what a page of another site makes a browser ask for.

    A simulator sends no Origin. A browser does, and it must be that of our own page. For a plain
    image or link it sends none, but Sec-Fetch-Site; another site's may show the page, and open no
    session. On loopback the Host must be loopback's, too: a site can give its own name our address
    (DNS rebinding).

    Args:
        exposed: the server is meant to be reached under any name.
        notices: told of who is refused.
    """

    def __init__(self, exposed: bool, notices: Notices) -> None:
        self.exposed, self.notices = exposed, notices

    def allows(self, origin: str | None, environ: dict) -> bool:
        """Whether a request with this Origin, or none, is answered."""
        host = environ.get("HTTP_HOST")
        if origin and origin not in (f"http://{host}", f"https://{host}"):
            return False
        if self.exposed:
            return True
        site = environ.get("HTTP_SEC_FETCH_SITE", "none")
        if site not in OWN_SITES and environ.get("PATH_INFO", "").startswith("/socket.io"):
            return False
        return host is None or is_loopback(urlsplit(f"//{host}").hostname or "")

    def __call__(self, app: Callable) -> Callable:
        def guarded(environ: dict, start_response: Callable) -> Iterable[bytes]:
            origin = environ.get("HTTP_ORIGIN")
            try:
                allowed = self.allows(origin, environ)
            except ValueError:  # a Host that is none
                allowed = False
            if allowed:
                return app(environ, start_response)
            who = origin or environ.get("HTTP_HOST")
            self.notices.say("a page of another site was refused", f"{who:.80}")
            start_response("403 Forbidden", [("Content-Type", "text/plain")])
            return [b"only pages of this server and simulators are answered\n"]

        return guarded
