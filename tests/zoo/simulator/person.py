"""A person at the page of a drive: requests as the browser sends them."""

import json
import time
import urllib.request
from collections.abc import Callable


class Person:
    """A person who watches and drives.

    Args:
        url: address of the page.
    """

    def __init__(self, url: str) -> None:
        self.url, self.state = url, {"number": 0}

    def look(self) -> dict:
        """Return the state of the next frame."""
        address = f"{self.url}/frame?after={self.state['number']}"
        with urllib.request.urlopen(address, timeout=10) as answer:
            body = answer.read()
        if body:
            end = 4 + int.from_bytes(body[:4], "little")
            self.state, self.jpeg = json.loads(body[4:end]), body[end:]
        return self.state

    def until(self, reached: Callable[[dict], bool], seconds: float = 20) -> dict:
        ends = time.monotonic() + seconds
        while not reached(self.look()):
            assert time.monotonic() < ends, self.state
        return self.state

    def send(self, **command: object) -> dict:
        kind, sent = {"Content-Type": "application/json"}, json.dumps(command).encode()
        request = urllib.request.Request(f"{self.url}/command", sent, kind)
        with urllib.request.urlopen(request, timeout=10) as answer:
            return json.load(answer)

    def hold(self, *keys: str, **hands: float) -> None:
        self.send(hands={"held": list(keys), **hands})
