"""The page on which a person drives: the latest frame to the browser, the hands back from it."""

import json
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np

from zoo.base.page_requests import Answer, ServedPage, json_answer, read_command
from zoo.base.page_server import PageServer
from zoo.simulator.hand_control import Hands
from zoo.simulator.recorder import encode

HAND_FILES = Path(__file__).with_name("static") / "hand_page"
WAIT_S = 0.5  # that a request waits for the next frame
WATCHED_S = 1.5  # after a page's last request the hands are off the wheel
MOST_PRESSED = 20  # keys that wait to be handled
Press = Literal["r", "space", "backspace", "escape"]
COMMANDS: dict[str, Any] = {"hands": Hands, "press": Press}


class LatestFrame:
    """The latest frame with its state; what no page has asked for in time is dropped."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._number, self._body, self._asked_s = 0, b"", -math.inf

    @property
    def watched(self) -> bool:
        """Whether a page asks for frames."""
        return time.monotonic() - self._asked_s < WATCHED_S

    def show(self, frame: np.ndarray | bytes, **state: object) -> None:
        """Publish a frame, uint8 [H, W, 3] RGB or its JPEG, and plain values that belong to it."""
        jpeg = frame if isinstance(frame, bytes) else encode(frame)
        with self._changed:
            self._number += 1
            head = json.dumps({"number": self._number, **state}).encode()
            self._body = len(head).to_bytes(4, "little") + head + jpeg
            self._changed.notify_all()

    def answer(self, query: dict) -> Answer:
        """Return length and JSON of the state, and the JPEG, of a frame after number `after`.

        Without a newer frame in time the answer is the same frame again, or empty before the first.
        """
        after = query.get("after", ["0"])[0]
        self._asked_s = time.monotonic()
        with self._changed:
            self._changed.wait_for(lambda: after != str(self._number), WAIT_S)
            self._asked_s = time.monotonic()
            return self._body, "application/octet-stream"


class Seat(LatestFrame):
    """A driver's seat: the latest frame for pages, and the latest hands from them."""

    def __init__(self) -> None:
        super().__init__()
        self._hands, self._pressed = Hands(), list[str]()

    @property
    def hands(self) -> Hands:
        """Return what the person does; nothing while no page is open."""
        return self._hands if self.watched else Hands()

    def pressed(self) -> list[str]:
        """Return the keys that were pressed since the last call."""
        pressed, self._pressed = self._pressed, []
        return pressed

    def show_until_ended(self, frame: np.ndarray) -> None:
        """Show a frame; raise KeyboardInterrupt when the person has ended the drive."""
        self.show(frame)
        if "escape" in self.pressed():
            raise KeyboardInterrupt

    def take(self, name: str, value: Any) -> None:
        """Take a command of `COMMANDS`."""
        if name == "hands":
            self._hands = value
        else:
            self._pressed = [*self._pressed, value][-MOST_PRESSED:]


class HandPage(ServedPage):
    """WSGI application of the page.

    Args:
        seat: seat of the person.
    """

    def __init__(self, seat: Seat) -> None:
        self.seat = seat
        super().__init__(HAND_FILES, {"/frame": seat.answer})

    def _command(self, environ: dict) -> Answer:
        self.seat.take(*read_command(environ, COMMANDS))
        return json_answer({})


@contextmanager
def served_seat(say: Callable[[str], object], port: int = 0, purpose: str = "") -> Iterator[Seat]:
    """Serve the page on this machine while the block runs.

    Args:
        say: function that prints a line.
        port: TCP port; 0 for a free one.
        purpose: what the page is for, in words.

    Raises:
        InputError: the port is in use.
    """
    seat = Seat()
    with PageServer(port, HandPage(seat)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            say(f"open http://{server.server_name}:{server.server_port} in a browser{purpose}")
            yield seat
        finally:
            server.shutdown()
