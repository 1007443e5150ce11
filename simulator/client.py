"""The command `drivezoo simulator client track=lake url=...`: a client for a driver."""

import time
from collections.abc import Callable
from contextlib import ExitStack, closing

import numpy as np
from rich.console import Console

from simulator.autonomous_mode import START, Client, Socket
from simulator.command_options import ClientOptions
from simulator.film import Film
from simulator.legacy_socket import HandshakeRefusedError, HandshakeSilentError, LegacySocket
from simulator.weather import read_weather
from simulator.world import Start, open_world

RETRY_S = 0.5  # seconds between attempts to connect


def run_client(options: ClientOptions, console: Console) -> Client:
    """Connect and drive, reconnect after each lost connection, and print a summary.

    Raises:
        InputError: an option is wrong, no renderer opens, or the film cannot be written.
    """
    options.check()
    world = open_world(renderer=options.renderer, **options.place)
    world.reset(options.seed, Start(options.start), read_weather(options.weather))
    client = Client(world, options, console)
    client.print_once(f"{world.track.name}, drawn by the {world.renderer.name} renderer")
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
    replies, dropped = client.replies, client.dropped
    if not client.counts["connections"]:
        client.began_s = client.next_frame_s = time.monotonic()
    client.counts["connections"] += 1
    try:
        with closing(socket):
            client.drive(socket)
    except ConnectionError as error:
        client.report_disconnection(error)
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
