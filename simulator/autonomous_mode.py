"""The original's autonomous mode: a car in a world, steered by a driver's replies to telemetry."""

import math
import time
from collections import Counter
from collections.abc import Callable
from typing import Protocol

import numpy as np
from rich.console import Console

from simulator.command_options import ClientOptions
from simulator.legacy_socket import OPENED, UNREADABLE
from simulator.telemetry import make_telemetry, read_put_back, read_steer
from simulator.world import Start, World

SILENT_S = 5.0  # seconds without a reply until the client reports it
LATE_S = 1 / 3  # longest lag behind real time that is caught up; the rest is skipped
START = "start it with: drivezoo drive CKPT"
REPLIES = {
    "steer": '42["steer",{"steering_angle":"0.0500","throttle":"0.2000"}]',
    "manual": '42["manual",{}]',
}


class Socket(Protocol):
    """Interface of `LegacySocket` and `ModernSocket`."""

    def emit(self, name: str, data: object) -> None:
        """Send an event."""

    def events(self, wait_s: float) -> list[tuple[str, object]]:
        """Return the events received within `wait_s` seconds."""

    def close(self) -> None:
        """Close the connection."""


class Client:
    """A world that a driver steers over a socket.

    Args:
        world: world with a renderer.
        options: options of the client.
        console: console for messages to the user; each message is printed once.
    """

    def __init__(self, world: World, options: ClientOptions, console: Console) -> None:
        self.world, self.options, self.console = world, options, console
        self.command = (0.0, 0.0)
        self.cte: list[float] = []
        self.counts: Counter[str] = Counter()
        self.due = 0  # telemetry messages to send at the next frame, as the original does
        self.expected = "steer"  # reply to the last message sent
        self.printed: set[str] = set()
        self.began_s = self.connected_s = self.replied_s = self.next_frame_s = time.monotonic()
        self.dropped = self.held = self.opened = False
        self.on_frame: list[Callable[[np.ndarray], None]] = []  # called with each frame
        self._frame: tuple[int, np.ndarray] | None = None

    @property
    def manual(self) -> bool:
        """Return whether a simulated person holds W now."""
        return any(begin <= self.world.time < end for begin, end in self.options.manual)

    @property
    def replies(self) -> int:
        """Return the number of replies so far."""
        return self.counts["steer"] + self.counts["manual"]

    @property
    def finished(self) -> bool:
        """Return whether the laps or seconds of the options are driven, or an open road ended."""
        options, world = self.options, self.world
        return bool(
            world.is_complete(options.laps or math.inf)
            or (options.seconds and world.time >= options.seconds)
        )

    def drive(self, socket: Socket) -> None:
        """Drive until `finished`; raise ConnectionError when the driver disconnects."""
        realtime = self.options.clock == "realtime"
        self.due, self.connected_s = 0, time.monotonic()
        self.replied_s = self.connected_s
        self.opened = self.options.protocol != "legacy"  # a modern socket is open already
        self.emit(socket)  # the original sends unasked at connecting, and again after OPEN
        while not self.finished:
            left = self.next_frame_s - time.monotonic()
            for name, data in socket.events(left if realtime else 0.25):
                self.handle_event(socket, name, data)
            if realtime and time.monotonic() >= self.next_frame_s:
                self.advance()
                for _ in range(self.due):
                    self.emit(socket)
                self.due = 0
            self._report_silence()
            if self.options.drop_at is not None and not self.dropped:
                self._drop(socket)

    def pause(self, wait_s: float) -> None:
        """Wait without a driver; in real time a car that was driven keeps its last command."""
        until = time.monotonic() + wait_s
        if self.options.clock == "lockstep" or not self.replies:
            time.sleep(wait_s)
            return
        while time.monotonic() < until and not self.finished:
            time.sleep(max(self.next_frame_s - time.monotonic(), 0))
            self.advance()

    def handle_event(self, socket: Socket, name: str, data: object) -> None:
        """Handle a reply; discard it, and send nothing, if the original client would discard it."""
        if name == OPENED:
            self.opened = True
            self.emit(socket)
            return
        if name == UNREADABLE:
            self._discard("a message", f"{str(data)[:80]!r} is not an event with a name")
            return
        if name not in REPLIES:
            return
        try:
            if isinstance(data, tuple):
                raise ValueError(f"it has {len(data)} arguments, expected one object")
            put_back_mph = None
            if name == "steer":
                self.command = read_steer(data, self.options.decimal_comma)
                if self.options.put_back:
                    put_back_mph = read_put_back(data, self.options.decimal_comma)
        except ValueError as error:
            self._discard(f"a {name}", str(error))
            return
        self.replied_s = time.monotonic()
        self.counts[name] += 1
        if put_back_mph is not None:
            self.put_back(put_back_mph)
        if self.options.clock == "realtime":
            self.due += 1
            return
        if put_back_mph is None:  # after put_back, the command belongs to the old place
            self.advance()
        self.emit(socket)

    def put_back(self, speed_mph: float) -> None:
        """Put the car on the centreline, pointing along the road."""
        self.counts["put back"] += 1
        self.world.put_back(Start(self.world.place.distance, speed_mph=speed_mph))
        self._frame = None

    def advance(self) -> None:
        """Advance the world by one frame."""
        next_frame_s = self.next_frame_s + self.world.frame_s
        self.next_frame_s = max(next_frame_s, time.monotonic() - LATE_S)
        held, was_off = self.manual, self.world.off_road
        self.counts["taken over"] += held and not self.held
        self.held = held
        self.world.step(*((0.0, 1.0) if held else self.command))
        self.cte.append(self.world.cte)
        self.counts["off road"] += self.world.off_road and not was_off
        if self.on_frame:
            for each in self.on_frame:
                each(self.frame())

    def emit(self, socket: Socket) -> None:
        """Send telemetry, or null while a simulated person drives."""
        self.counts["telemetry"] += 1
        self.expected = "manual" if self.manual else "steer"
        if self.manual:
            socket.emit("telemetry", None)
            return
        car, comma = self.world.car, self.options.decimal_comma
        frame = self.frame()
        message = make_telemetry(
            frame, car.steering, car.throttle, car.speed_mph, comma, self._truth()
        )
        socket.emit("telemetry", message)

    def _truth(self) -> dict[str, float]:
        """Return telemetry beyond the original's: the time, and inputs of scoring."""
        if not self.options.truth:
            return {}
        world = self.world
        return {
            "time": world.time,
            "cte": world.cte,
            "lane": world.place.width / 2,
            "wall": float(world.at_wall),
            "put_back": float(self.options.put_back),
        }

    def frame(self) -> np.ndarray:
        """Return the centre camera's frame; it is drawn once for each frame of the world."""
        if self._frame is None or self._frame[0] != self.world.frames:
            self._frame = self.world.frames, self.world.frame()
        return self._frame[1]

    def print_once(self, text: str) -> None:
        """Print a line, unless it was printed before."""
        if text not in self.printed:
            self.printed.add(text)
            self.console.print(text, highlight=False, markup=False, emoji=False, soft_wrap=True)

    def _discard(self, what: str, reason: str) -> None:
        self.counts["discarded"] += 1
        self.print_once(f"{what} was discarded, as the original client does: {reason}")

    def _report_silence(self) -> None:
        if time.monotonic() - self.replied_s > SILENT_S:
            if not self.opened:
                self.report_no_handshake()
            self.print_once(
                f"no reply for {SILENT_S:.0f} s; the client never sends a message twice, so answer "
                f"each one; expected: {REPLIES[self.expected]}"
            )

    def report_no_handshake(self) -> None:
        """Print that a server accepts connections but does not answer as a driver."""
        self.print_once(
            f"connected to {self.options.url}, but no answer to the handshake for "
            f"{SILENT_S:.0f} s; is another program on the port? {START}"
        )

    def report_disconnection(self, error: ConnectionError) -> None:
        """Print why the driver disconnected."""
        if time.monotonic() - self.connected_s > SILENT_S:
            self.printed.clear()  # after a longer connection, messages are printed again
        self.print_once(f"disconnected ({error}); connecting again")

    def _drop(self, socket: Socket) -> None:
        if self.world.time >= self.options.drop_at:
            self.dropped = True
            raise ConnectionError(f"dropped by drop_at={self.options.drop_at:g}")
