"""`python -m simulator client track=lake url=...`: the original's autonomous mode."""

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
SILENT_S = 5.0  # without a reply, a person wants to know
LATE_S = 1 / 3  # what a slow computer falls behind by in real time, it does not drive later
START = "start it with: python -m zoo.drive CKPT"
REPLIES = {
    "steer": '42["steer",{"steering_angle":"0.0500","throttle":"0.2000"}]',
    "manual": '42["manual",{}]',
}


class Socket(Protocol):
    """`LegacySocket` or `ModernSocket`."""

    def emit(self, name: str, data: object) -> None: ...

    def events(self, wait_s: float) -> list[tuple[str, object]]: ...

    def close(self) -> None: ...


class Client:
    """A world that a driver on the socket drives.

    Args:
        world: with a renderer.
        options: see `ClientOptions`.
        console: for what a person should know; each thing is said once.
    """

    def __init__(self, world: World, options: ClientOptions, console: Console) -> None:
        self.world, self.options, self.console = world, options, console
        self.command = (0.0, 0.0)
        self.cte: list[float] = []
        self.counts: Counter[str] = Counter()
        self.waiting = 0  # emits that the original would do at its next frame
        self.expected = "steer"  # the reply to what was sent last
        self.said: set[str] = set()
        self.began = self.heard = self.next_frame = time.monotonic()
        self.dropped = self.held = self.opened = False
        self.on_frame: list[Callable[[np.ndarray], None]] = []  # called with each frame drawn
        self._frame: tuple[int, np.ndarray] | None = None

    @property
    def manual(self) -> bool:
        """Whether a person holds W."""
        return any(begin <= self.world.time < end for begin, end in self.options.manual)

    @property
    def obeyed(self) -> int:
        """How many replies there were so far."""
        return self.counts["steer"] + self.counts["manual"]

    @property
    def finished(self) -> bool:
        """Whether the laps or the seconds asked for are over."""
        options, world = self.options, self.world
        return bool(
            (options.laps and world.travelled >= options.laps * world.track.length)
            or (options.seconds and world.time >= options.seconds)
        )

    def drive(self, socket: Socket) -> None:
        """Until the end that the options name; raises ConnectionError when the driver goes."""
        realtime = self.options.clock == "realtime"
        self.waiting, self.heard = 0, time.monotonic()
        self.opened = self.options.protocol != "legacy"  # else a socket is open before this
        self.emit(socket)  # unasked, as the socket opens; and once more for the OPEN packet
        while not self.finished:
            left = self.next_frame - time.monotonic()
            for name, data in socket.events(left if realtime else 0.25):
                self.take(socket, name, data)
            if realtime and time.monotonic() >= self.next_frame:
                self.advance()
                for _ in range(self.waiting):
                    self.emit(socket)
                self.waiting = 0
            self._say_silence()
            if self.options.drop_at is not None and not self.dropped:
                self._drop(socket)

    def pause(self, wait_s: float) -> None:
        """Without a driver. In real time a car that was driven drives on."""
        until = time.monotonic() + wait_s
        if self.options.clock == "lockstep" or not self.obeyed:
            time.sleep(wait_s)
            return
        while time.monotonic() < until and not self.finished:
            time.sleep(max(self.next_frame - time.monotonic(), 0))
            self.advance()

    def take(self, socket: Socket, name: str, data: object) -> None:
        """Obey an event. What the original would swallow ends its loop here too."""
        if name == OPENED:
            self.opened = True
            self.emit(socket)
            return
        if name == UNREADABLE:
            self._swallow("a message", f"{str(data)[:80]!r} is no event with a name")
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
            self._swallow(f"a {name}", str(error))
            return
        self.heard = time.monotonic()
        self.counts[name] += 1
        if put_back_mph is not None:
            self.put_back(put_back_mph)
        if self.options.clock == "realtime":
            self.waiting += 1
            return
        if put_back_mph is None:  # else the command is for the place that the car has left
            self.advance()
        self.emit(socket)

    def put_back(self, speed_mph: float) -> None:
        """Set the car down on the centre, pointing ahead."""
        self.counts["put back"] += 1
        self.world.put_back(Start(self.world.place.distance, speed_mph=speed_mph))
        self._frame = None

    def advance(self) -> None:
        """Drive for a frame's time."""
        self.next_frame = max(self.next_frame + self.world.frame_s, time.monotonic() - LATE_S)
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
        """Send telemetry, or null while a person drives."""
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
        """What the original does not send: the time, and what a scorer needs."""
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
        """The centre camera's picture, drawn once a frame."""
        if self._frame is None or self._frame[0] != self.world.frames:
            self._frame = self.world.frames, self.world.frame()
        return self._frame[1]

    def say(self, text: str) -> None:
        """Print a line, once."""
        if text not in self.said:
            self.said.add(text)
            self.console.print(text, highlight=False, markup=False, emoji=False, soft_wrap=True)

    def _swallow(self, what: str, reason: str) -> None:
        self.counts["swallowed"] += 1
        self.say(f"{what} was swallowed, as by the original, and its loop ends: {reason}")

    def _say_silence(self) -> None:
        if time.monotonic() - self.heard > SILENT_S:
            if not self.opened:
                self.say_no_handshake()
            self.say(
                f"no reply for {SILENT_S:.0f} s, and the original never asks again; expected: "
                f"{REPLIES[self.expected]}"
            )

    def say_no_handshake(self) -> None:
        """Print that something is there, which does not speak as a driver does."""
        self.say(
            f"connected to {self.options.url}, but the driver has not answered the handshake for "
            f"{SILENT_S:.0f} s; is another program on the port? {START}"
        )

    def _drop(self, socket: Socket) -> None:
        if self.world.time >= self.options.drop_at:
            self.dropped = True
            raise ConnectionError("dropped, as asked")


def run_client(options: ClientOptions, console: Console) -> Client:
    """Connect, drive, reconnect when need be, and say at the end how it went.

    Raises:
        SimulatorError: an option that cannot be, no renderer, a film that cannot be written.
    """
    check_options(options)
    world = open_world(renderer=options.renderer, **options.place)
    world.reset(options.seed, Start(options.start), read_weather(options.weather))
    client = Client(world, options, console)
    client.say(f"{world.track.name}, drawn by the {world.pictures.name} renderer")
    with ExitStack() as open_things:
        if options.film:
            client.on_frame.append(
                open_things.enter_context(Film(options.film, options.frame_rate)).add
            )
        if options.window:
            client.on_frame.append(_window(world.track.name))
        try:
            while not client.finished:
                _drive_until_gone(client)
        except KeyboardInterrupt:
            client.say("stopped")
        finally:
            _summary(client)
    return client


def _drive_until_gone(client: Client) -> None:
    options = client.options
    try:
        socket = _connect(options)
    except HandshakeSilentError:
        client.say_no_handshake()
        client.pause(RETRY_S)
        return
    except OSError as error:
        there = f" (what listens there says {error})" * isinstance(error, HandshakeRefusedError)
        client.say(f"waiting for a driver at {options.url}; {START}{there}")
        client.pause(RETRY_S)
        return
    connected, obeyed, dropped = time.monotonic(), client.obeyed, client.dropped
    if not client.counts["connections"]:
        client.began = client.next_frame = connected
    client.counts["connections"] += 1
    try:
        with closing(socket):
            client.drive(socket)
    except ConnectionError as error:
        if time.monotonic() - connected > SILENT_S:
            client.said.clear()  # a driver that was there and went is news, each time
        client.say(f"the connection is gone ({error}); connecting again")
        if client.obeyed == obeyed and client.dropped == dropped:
            client.pause(RETRY_S)  # sent away at the door


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
            raise KeyboardInterrupt  # closed by the person

    return show


def _summary(client: Client) -> None:
    world, counts = client.world, client.counts
    put_back = f", {counts['put back']} times put back" if client.options.put_back else ""
    cte = np.abs(client.cte) if client.cte else np.zeros(1)
    wall_s = max(time.monotonic() - client.began, 1e-9)
    client.say(
        f"{world.travelled / world.track.length:.2f} laps in {world.time:.1f} s of simulated time; "
        f"{world.frames:,} frames, {world.frames / wall_s:.0f} a second; {counts['telemetry']:,} "
        f"telemetry in {counts['connections']} connections; {counts['taken over']} times taken "
        f"over by hand; off centre {cte.mean():.2f} m on average, {cte.max():.2f} m at most; "
        f"{counts['off road']} times off the road{put_back}"
    )


def main(arguments: Sequence[str]) -> None:
    """The command: `key=value` arguments, see `ClientOptions`."""
    run_client(read_options(ClientOptions, arguments), Console())
