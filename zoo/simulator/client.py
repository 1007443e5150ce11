"""The command `drivezoo simulator client track=lake url=...`: the original's autonomous mode.

A car in a world is steered by a driver's replies to telemetry.
"""

import math
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from zoo.base.entry_points import load_named
from zoo.base.output_files import checked_file
from zoo.base.terminal import counted
from zoo.base.video import FILMS, Film
from zoo.simulator.command_options import DIALECTS, ClientOptions
from zoo.simulator.legacy_socket import (
    OPENED,
    UNREADABLE,
    HandshakeSilentError,
    LegacySocket,
    websocket_address,
)
from zoo.simulator.simulated_world import Start, World
from zoo.simulator.telemetry import make_telemetry, read_put_back, read_steer

if TYPE_CHECKING:
    from zoo.simulator.modern_socket import ModernSocket  # slow import: python-socketio

    Socket = LegacySocket | ModernSocket

RETRY_S = 0.5  # seconds between attempts to connect
SILENT_S = 5.0  # seconds without a reply until the client reports it
LATE_S = 1 / 3  # longest lag behind real time that is caught up; the rest is skipped
START = "start it with: drivezoo drive CKPT"
REPLIES = {
    "steer": '42["steer",{"steering_angle":"0.0500","throttle":"0.2000"}]',
    "manual": '42["manual",{}]',
}
Event = tuple[str, object]  # its name and its argument
Telemetry = tuple[str, dict[str, Any]]


class Client:
    """A world that a driver steers over a socket.

    Args:
        world: world with a renderer.
        options: options of the client.
        console: console for messages to the user; each message is printed once.

    Attributes:
        control: event that steers the car.
    """

    control = "steer"

    def __init__(self, world: World, options: ClientOptions, console: Console) -> None:
        self.world, self.options, self.console = world, options, console
        self.command = (0.0, 0.0)
        self.cte: list[float] = []
        self.counts: Counter[str] = Counter()
        self.due = 0  # telemetry messages to send at the next frame, as the original does
        self.printed: set[str] = set()
        self.began_s = self.connected_s = self.replied_s = self.next_frame_s = time.monotonic()
        self.dropped = self.held = self.opened = False
        self.on_frame: list[Callable[[np.ndarray], object]] = []  # called with each frame
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
        ends = self.world.time >= (self.options.seconds or math.inf)
        return ends or self.world.is_complete(self.options.laps or math.inf)

    @property
    def driven(self) -> str:
        """Return how far the car drove, in words."""
        return f"{self.world.travelled / self.world.track.length:.2f} laps"

    def run(self) -> None:
        """Connect and drive until the driver disconnects, or wait for one to connect to."""
        try:
            socket = self._connect()
        except HandshakeSilentError:
            self._report_no_handshake()
            self.pause()
            return
        except OSError as error:
            self.print_once(f"waiting for a driver at {self.options.url}; {START} ({error})")
            self.pause()
            return
        before = self.replies, self.dropped
        if not self.counts["connections"]:
            self.began_s = self.next_frame_s = time.monotonic()
        self.counts["connections"] += 1
        try:
            with closing(socket):
                self.drive(socket)
        except ConnectionError as error:
            if time.monotonic() - self.connected_s > SILENT_S:
                self.printed.clear()  # after a longer connection, messages are printed again
            self.print_once(f"disconnected ({error}); connecting again")
            if before == (self.replies, self.dropped):
                self.pause()  # the driver refused the client

    def drive(self, socket: "Socket") -> None:
        """Drive until `finished`; raise ConnectionError when the driver disconnects."""
        options = self.options
        realtime, drop_s = options.clock == "realtime", options.drop_at
        self.due = 0
        self.connected_s = self.replied_s = time.monotonic()
        self.opened = options.protocol != "legacy"  # a modern socket is open already
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
            if time.monotonic() - self.replied_s > SILENT_S:
                self._report_silence()
            if drop_s is not None and self.world.time >= drop_s and not self.dropped:
                self.dropped = True
                raise ConnectionError(f"dropped by drop_at={drop_s:g}")

    def pause(self) -> None:
        """Wait without a driver; in real time a car that was driven keeps its last command."""
        until = time.monotonic() + RETRY_S
        if self.options.clock == "lockstep" or not self.replies:
            time.sleep(RETRY_S)
            return
        while time.monotonic() < until and not self.finished:
            time.sleep(max(self.next_frame_s - time.monotonic(), 0))
            self.advance()

    def handle_event(self, socket: "Socket", name: str, data: object) -> None:
        """Handle a reply; discard it, and send nothing, if the original client would discard it."""
        put_back_mph = None
        if name == OPENED:
            self.opened = True
            self.emit(socket)
            return
        try:
            if name == UNREADABLE:
                raise ValueError(f"{str(data)[:80]!r} is not an event with a name")
            if name not in REPLIES:
                return
            if isinstance(data, tuple):
                raise ValueError(f"it has {len(data)} arguments, expected one object")
            if name == "steer":
                self.command = read_steer(data, self.options.decimal_comma)
                if self.options.put_back:
                    put_back_mph = read_put_back(data, self.options.decimal_comma)
        except ValueError as error:
            self.counts["discarded"] += 1
            self.print_once(f"a message ({name}) was discarded, as the original does: {error}")
            return
        self.replied_s = time.monotonic()
        self.counts[name] += 1
        if put_back_mph is not None:
            self.counts["put back"] += 1
            self.world.put_back(Start(self.world.place.distance, speed_mph=put_back_mph))
            self._frame = None
        if self.options.clock == "realtime":
            self.due += 1
            return
        if put_back_mph is None:  # after put_back, the command belongs to the old place
            self.advance()
        self.emit(socket)

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
        for show in self.on_frame:
            show(self.frame())

    def emit(self, socket: "Socket") -> None:
        """Send telemetry, or null to drivers of `steer` while a simulated person drives."""
        self.counts["telemetry"] += 1
        is_null = self.manual and self.control == Client.control
        socket.emit(*(("telemetry", None) if is_null else self.telemetry()))

    def telemetry(self) -> Telemetry:
        """Return the event of the car's state and frame."""
        car, comma = self.world.car, self.options.decimal_comma
        state = car.steering, car.throttle, car.speed_mph
        return "telemetry", make_telemetry(self.frame(), *state, comma, self.truth())

    def truth(self) -> dict[str, float]:
        """Return numbers that the original does not send: time, place, and inputs of scoring."""
        world = self.world
        if not self.options.truth:
            return {}
        return {
            "time": world.time,
            "lap": world.lap + 1,
            "x": world.car.x,
            "y": world.car.y,
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

    def print_summary(self) -> None:
        """Print the figures of the drive."""
        counts, frames = self.counts, len(self.cte)
        cte = np.abs(self.cte) if self.cte else np.zeros(1)
        wall_s = max(time.monotonic() - self.began_s, 1e-9)
        back, hand, off, connected = (
            counted(counts[name], "time")
            for name in ("put back", "taken over", "off road", "connections")
        )
        put_back = f", put back {back}" if self.options.put_back else ""
        self.print_once(
            f"{self.driven} in {frames * self.world.frame_s:.1f} s of simulated time; "
            f"{counted(frames, 'frame')}, {frames / wall_s:.0f} per second; "
            f"{counted(counts['telemetry'], 'telemetry message')}; "
            f"connected {connected}; taken over by hand {hand}; "
            f"cross-track error {cte.mean():.2f} m on average, {cte.max():.2f} m at most; "
            f"left the road {off}{put_back}"
        )

    def _connect(self) -> "Socket":
        if self.options.protocol == "legacy":
            return LegacySocket(self.options.url)
        from zoo.simulator.modern_socket import ModernSocket

        return ModernSocket(self.options.url)

    def _report_silence(self) -> None:
        if not self.opened:
            self._report_no_handshake()
        expected = REPLIES["manual" if self.manual else "steer"].replace("steer", self.control, 1)
        self.print_once(
            f"no reply for {SILENT_S:.0f} s; the client never sends a message twice, so answer "
            f"each one; expected: {expected}"
        )

    def _report_no_handshake(self) -> None:
        self.print_once(
            f"connected to {self.options.url}, but no answer to the handshake for "
            f"{SILENT_S:.0f} s; is another program on the port? {START}"
        )


def run_client(options: ClientOptions, console: Console) -> Client:
    """Connect and drive, reconnect after each lost connection, and print a summary.

    Args:
        options: options of the client.
        console: console for messages to the user.

    Raises:
        InputError: an option is wrong, there is no such dialect, no renderer opens, or the film
            cannot be written.
    """
    options.check()
    websocket_address(options.url)
    is_original = options.dialect == ClientOptions.dialect
    kind = Client if is_original else load_named(DIALECTS, options.dialect, Client)
    world = options.open()
    client = kind(world, options, console)
    client.print_once(f"{world.track.name}, drawn by the {world.drawing().name} renderer")
    with ExitStack() as open_things:
        if options.film:
            path = checked_file(options.film, FILMS, "film")
            client.on_frame.append(open_things.enter_context(Film(path, options.frame_rate)).add)
        if options.window:
            from zoo.simulator.hand_page import served_seat

            seat = open_things.enter_context(served_seat(client.print_once))
            client.on_frame.append(seat.show_until_ended)
        try:
            while not client.finished:
                client.run()
        except KeyboardInterrupt:
            client.print_once("stopped")
        finally:
            client.print_summary()
    return client
