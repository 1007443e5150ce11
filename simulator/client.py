"""The command `python -m simulator client track=lake url=...`: a client for a driver."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from typing import Protocol

import numpy as np
from rich.console import Console

from simulator.bounded_socket import HandshakeSilentError
from simulator.client_options import ClientOptions, check_options
from simulator.command_line import read_options
from simulator.film import Film
from simulator.legacy_socket import (
    OPENED,
    UNREADABLE,
    HandshakeRefusedError,
    LegacySocket,
)
from simulator.telemetry import make_telemetry, read_put_back, read_steer
from simulator.weather import read_weather
from simulator.world import Start, World, open_world

RETRY_S = 0.5
SILENT_S = 5.0  # seconds without a reply until the client reports it
LATE_S = 1 / 3  # longest lag behind real time that is caught up; the rest is skipped
START = "start it with: python -m zoo.drive CKPT"
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
        self.began_s = self.replied_s = self.next_frame_s = time.monotonic()
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
        """Return whether the laps or seconds of the options are driven."""
        options, world = self.options, self.world
        return bool(
            (options.laps and world.travelled >= options.laps * world.track.length)
            or (options.seconds and world.time >= options.seconds)
        )

    def drive(self, socket: Socket) -> None:
        """Drive until `finished`; raise ConnectionError when the driver disconnects."""
        realtime = self.options.clock == "realtime"
        self.due, self.replied_s = 0, time.monotonic()
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
            "lane": world.track.width / 2,
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

    def _drop(self, socket: Socket) -> None:
        if self.world.time >= self.options.drop_at:
            self.dropped = True
            raise ConnectionError(f"dropped by drop_at={self.options.drop_at:g}")


def run_client(options: ClientOptions, console: Console) -> Client:
    """Connect and drive, reconnect after each lost connection, and print a summary.

    Raises:
        SimulatorError: an option is wrong, no renderer opens, or the film cannot be written.
    """
    check_options(options)
    world = open_world(
        options.track,
        options.renderer,
        options.quality,
        options.frame_rate,
        options.delay_s,
        options.direction,
    )
    world.reset(options.seed, Start(options.start), read_weather(options.weather))
    client = Client(world, options, console)
    client.print_once(f"{world.track.name}, drawn by the {world.pictures.name} renderer")
    with ExitStack() as open_things:
        if options.film:
            client.on_frame.append(
                open_things.enter_context(Film(options.film, options.frame_rate)).add
            )
        if options.window:
            client.on_frame.append(_window(world.track.name))
        try:
            while not client.finished:
                _drive_until_disconnected(client)
        except KeyboardInterrupt:
            client.print_once("stopped")
        finally:
            _print_summary(client)
    return client


def _drive_until_disconnected(client: Client) -> None:
    options = client.options
    try:
        socket = _connect(options)
    except HandshakeSilentError:
        client.report_no_handshake()
        client.pause(RETRY_S)
        return
    except OSError as error:
        answer = f" (the server there answers {error})" * isinstance(error, HandshakeRefusedError)
        client.print_once(f"waiting for a driver at {options.url}; {START}{answer}")
        client.pause(RETRY_S)
        return
    connected_s, replies, dropped = time.monotonic(), client.replies, client.dropped
    if not client.counts["connections"]:
        client.began_s = client.next_frame_s = connected_s
    client.counts["connections"] += 1
    try:
        with closing(socket):
            client.drive(socket)
    except ConnectionError as error:
        if time.monotonic() - connected_s > SILENT_S:
            client.printed.clear()  # after a longer connection, messages are printed again
        client.print_once(f"disconnected ({error}); connecting again")
        if client.replies == replies and client.dropped == dropped:
            client.pause(RETRY_S)  # the driver refused the client


def _connect(options: ClientOptions) -> Socket:
    if options.protocol == "legacy":
        return LegacySocket(options.url)
    from simulator.modern_socket import ModernSocket

    return ModernSocket(options.url)


def _window(title: str) -> Callable[[np.ndarray], None]:
    from simulator.window import open_viewer

    viewer = open_viewer(title)

    def show(frame: np.ndarray) -> None:
        if not viewer.show(frame):
            raise KeyboardInterrupt  # the user closed the window

    return show


def _print_summary(client: Client) -> None:
    world, counts = client.world, client.counts
    put_back = f", put back {counts['put back']} times" if client.options.put_back else ""
    cte = np.abs(client.cte) if client.cte else np.zeros(1)
    wall_s = max(time.monotonic() - client.began_s, 1e-9)
    client.print_once(
        f"{world.travelled / world.track.length:.2f} laps in {world.time:.1f} s of simulated time; "
        f"{world.frames:,} frames, {world.frames / wall_s:.0f} per second; "
        f"{counts['telemetry']:,} telemetry messages; connected {counts['connections']} times; "
        f"taken over by hand {counts['taken over']} times; cross-track error {cte.mean():.2f} m "
        f"on average, {cte.max():.2f} m at most; left the road {counts['off road']} times{put_back}"
    )


def main(arguments: Sequence[str]) -> None:
    """Run the command with `key=value` arguments; see `ClientOptions`."""
    run_client(read_options(ClientOptions, arguments), Console())
