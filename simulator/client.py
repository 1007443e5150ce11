"""`python -m simulator client track=lake url=...`: the original's autonomous mode."""

import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from rich.console import Console

from simulator.command_line import read_options
from simulator.errors import SimulatorError
from simulator.film import Film
from simulator.legacy_socket import OPENED, LegacySocket
from simulator.telemetry import make_telemetry, read_steer
from simulator.weather import read_weather
from simulator.world import Start, World, open_world

RETRY_S = 0.5
SILENT_S = 5.0  # without a reply, a person wants to know


@dataclass(frozen=True)
class ClientOptions:
    """Drive as a driver on the socket commands: the original's autonomous mode.

    On the wire it behaves like the original client of 2016, but for one thing: where nobody listens
    it tries twice a second, not thousands of times.

    Args:
        track: its name, or the path of a track's YAML file.
        url: of the driver.
        protocol: legacy, as the original speaks, or modern, as today's libraries do.
        clock: lockstep advances a frame for each reply; realtime drives on meanwhile.
        frame_rate: frames per second of simulated time, up to 50.
        seed: of the weather.
        weather: clear, random for a day drawn from the seed, or {fog: 0.4, wet: 1}.
        start: metres along the lap.
        direction: 1, or -1 for the other way round.
        laps: ends after so many; 0 never does.
        seconds: ends after so many of simulated time; 0 never does.
        film: a path ending in .mp4; null for none.
        window: show what it sees.
        manual: pairs of seconds between which a person holds W, [[5,7],[20,21]].
        truth: tell the driver the simulated time and the cross-track error, too; the original does
            not.
        decimal_comma: write and read numbers as in a German locale.
        drop_at: the second in which the connection is dropped once; null for never.
        delay_s: from a command to the wheels.
        renderer: auto, software or opengl.
        quality: full or simple.
    """

    track: str = "lake"
    url: str = "http://127.0.0.1:4567"
    protocol: str = "legacy"
    clock: str = "lockstep"
    frame_rate: float = 15.0
    seed: int = 0
    weather: str = "clear"
    start: float = 0.0
    direction: int = 1
    laps: float = 0.0
    seconds: float = 0.0
    film: str | None = None
    window: bool = False
    manual: list[list[float]] = field(default_factory=list)
    truth: bool = False
    decimal_comma: bool = False
    drop_at: float | None = None
    delay_s: float = 0.0
    renderer: str = "auto"
    quality: str = "full"


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
        self.said: set[str] = set()
        self.heard = time.monotonic()
        self.dropped = False
        self.on_frame: list = []  # called with each frame that is drawn
        self._frame: tuple[int, np.ndarray] | None = None

    @property
    def manual(self) -> bool:
        """Whether a person holds W."""
        return any(begin <= self.world.time < end for begin, end in self.options.manual)

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
        self.emit(socket)  # unasked, as the socket opens; and once more for the OPEN packet
        next_frame = time.monotonic() + self.world.frame_s
        while not self.finished:
            late = next_frame - time.monotonic()
            for name, data in socket.events(late if realtime else 0.25):
                self.take(socket, name, data)
            if realtime and time.monotonic() >= next_frame:
                next_frame += self.world.frame_s
                self.advance()
                for _ in range(self.waiting):
                    self.emit(socket)
                self.waiting = 0
            self._say_silence()
            if self.options.drop_at is not None and not self.dropped:
                self._drop(socket)

    def take(self, socket: Socket, name: str, data: object) -> None:
        """Obey an event. What the original would swallow ends its loop here too."""
        if name == OPENED:
            self.emit(socket)
            return
        if name == "steer":
            try:
                self.command = read_steer(data, self.options.decimal_comma)
            except ValueError as error:
                self.counts["swallowed"] += 1
                self.say(f"a steer was swallowed, as by the original, and its loop ends: {error}")
                return
        elif name != "manual":
            return
        self.heard = time.monotonic()
        self.counts[name] += 1
        if self.options.clock == "realtime":
            self.waiting += 1
        else:
            self.advance()
            self.emit(socket)

    def advance(self) -> None:
        """Drive for a frame's time."""
        self.world.step(*((0.0, 1.0) if self.manual else self.command))
        self.cte.append(self.world.cte)
        self.counts["off road"] += self.world.off_road
        if self.on_frame:
            for each in self.on_frame:
                each(self.frame())

    def emit(self, socket: Socket) -> None:
        """Send telemetry, or null while a person drives."""
        self.counts["telemetry"] += 1
        if self.manual:
            self.counts["manual telemetry"] += 1
            socket.emit("telemetry", None)
            return
        car, comma = self.world.car, self.options.decimal_comma
        truth = {"time": self.world.time, "cte": self.world.cte} if self.options.truth else None
        frame = self.frame()
        message = make_telemetry(frame, car.steering, car.throttle, car.speed_mph, comma, truth)
        socket.emit("telemetry", message)

    def frame(self) -> np.ndarray:
        """The centre camera's picture, drawn once a frame."""
        if self._frame is None or self._frame[0] != self.world.frames:
            self._frame = self.world.frames, self.world.frame()
        return self._frame[1]

    def say(self, text: str) -> None:
        """Print a line, once."""
        if text not in self.said:
            self.said.add(text)
            self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def _say_silence(self) -> None:
        if time.monotonic() - self.heard > SILENT_S:
            expected = '["manual",{}]' if self.manual else '["steer",{"steering_angle":"...",...}]'
            self.say(
                f"no reply for {SILENT_S:.0f} s: expected 42{expected}; see python -m zoo.drive"
            )

    def _drop(self, socket: Socket) -> None:
        if self.world.time >= self.options.drop_at:
            self.dropped = True
            socket.close()
            raise ConnectionError("dropped, as asked")


def run_client(options: ClientOptions, console: Console) -> Client:
    """Connect, drive, reconnect when need be, and say at the end how it went.

    Raises:
        SimulatorError: an option that cannot be, no renderer, a film that cannot be written.
    """
    _check(options)
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
    client.say(f"{world.track.name}, drawn by the {world.pictures.name} renderer")
    began = time.monotonic()
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
            _summary(client, time.monotonic() - began)
    return client


def _drive_until_gone(client: Client) -> None:
    options = client.options
    try:
        socket = _connect(options)
    except OSError:
        client.say(
            f"waiting for a driver at {options.url}; start it with: python -m zoo.drive CKPT"
        )
        time.sleep(RETRY_S)
        return
    client.counts["connections"] += 1
    try:
        client.drive(socket)
        socket.close()
    except ConnectionError as error:
        client.say(f"the connection is gone ({error}); connecting again")


def _connect(options: ClientOptions) -> Socket:
    if options.protocol == "legacy":
        return LegacySocket(options.url)
    from simulator.modern_socket import ModernSocket

    return ModernSocket(options.url)


def _window(title: str):
    from simulator.window import open_viewer

    viewer = open_viewer(title)

    def show(frame: np.ndarray) -> None:
        if not viewer.show(frame):
            raise KeyboardInterrupt  # closed by the person

    return show


def _summary(client: Client, wall_s: float) -> None:
    world, counts = client.world, client.counts
    cte = np.abs(client.cte) if client.cte else np.zeros(1)
    laps, a_second = world.travelled / world.track.length, counts["telemetry"] / max(wall_s, 1e-9)
    client.say(
        f"{laps:.2f} laps in {world.time:.1f} s of simulated time; {counts['telemetry']:,} "
        f"telemetry, {a_second:.0f} a second; {counts['connections']} connections, "
        f"{counts['manual']} manual replies; off centre {cte.mean():.2f} m on average, "
        f"{cte.max():.2f} m at most; {counts['off road']} frames off the road"
    )


def _check(options: ClientOptions) -> None:
    choices = {"protocol": ("legacy", "modern"), "clock": ("lockstep", "realtime")}
    read_weather(options.weather)
    for key, known in choices.items():
        if getattr(options, key) not in known:
            raise SimulatorError(f"{key}={getattr(options, key)}: must be {' or '.join(known)}")
    if options.renderer == "none":
        raise SimulatorError("renderer=none: a driver needs pictures; try renderer=auto")
    if options.laps < 0 or options.seconds < 0:
        raise SimulatorError("laps and seconds must be 0 or more")
    if any(len(pair) != 2 or pair[0] >= pair[1] for pair in options.manual):
        raise SimulatorError("manual: must be pairs of seconds, [[5,7],[20,21]]")


def main(arguments: Sequence[str]) -> None:
    """The command: `key=value` arguments, see `ClientOptions`."""
    run_client(read_options(ClientOptions, arguments), Console())
