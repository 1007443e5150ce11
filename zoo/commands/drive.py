"""`drivezoo drive`: serve a checkpoint to simulators."""

import errno
import functools
import secrets
import signal
import subprocess
import threading
from contextlib import AbstractContextManager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.child_process import end_module, start_module
from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.base.entry_points import load_named
from zoo.base.errors import InputError
from zoo.base.new_folder import dated_folder
from zoo.base.terminal import print_written
from zoo.checkpoints.checkpoint_path import find_checkpoint, short_name
from zoo.server.drive_settings import DriveSettings, check_settings
from zoo.server.driven_simulator import SIMULATORS, DrivenSimulator
from zoo.simulator.track_names import file_name

if TYPE_CHECKING:
    from eventlet.greenio import GreenSocket

    from zoo.checkpoints.engine import Engine
    from zoo.checkpoints.policy_base import Policy


@command
def drive(ckpt: str, *, settings: DriveSettings) -> Path | None:
    """Serve a checkpoint to simulators.

    The checkpoint drives the original simulator (start it and choose autonomous mode) or the
    embedded one (sim=lake), or it drives in a Donkeycar simulator (world=donkey). Ctrl-C ends the
    drive.

      drivezoo drive latest speed=15
      drivezoo drive outputs/.../checkpoints/best.ckpt record=FOLDER sim=lake
      drivezoo drive lenet world=donkey port=9091 scene=generated_track

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet.
        settings: see `DriveSettings`.

    Returns:
        The drive's folder; None if no frame came.

    Raises:
        UsageError: other machines could connect although `expose` is false.
        InputError: see `serve`; the port is taken, or there is no such track.
    """
    check_settings(settings)
    checkpoint = str(find_checkpoint(ckpt))
    port = open_port(*settings.server, "page" if settings.world else "port")
    # The port is opened before the slow import of torch; simulators that connect wait.
    with StopOnSignal() as stop, port:
        return serve(checkpoint, settings, port, stop)


def serve(
    checkpoint: str, settings: DriveSettings, listener: "GreenSocket", stop: "StopOnSignal"
) -> Path | None:
    """Serve until Ctrl-C or the simulator's end, then print the drive's figures.

    Returns:
        The drive's folder; None if no frame came.

    Raises:
        InputError: the checkpoint cannot be loaded, or the simulator failed.
    """
    from zoo.base.notices import Notices
    from zoo.scoring.evidence import other_car_line
    from zoo.server.drive_writer import BackgroundWriter
    from zoo.server.driver import Driver
    from zoo.server.server import DriveServer

    simulator = settings.world and load_named(SIMULATORS, settings.world, DrivenSimulator)
    began, notices = datetime.now(), Notices()
    source = file_name(settings.place or "") if settings.world else None
    writer = BackgroundWriter(settings.record or dated_folder("drives"), notices, source)
    load = functools.partial(
        load_warm_policy,
        threads=settings.threads,
        engine=settings.engine,
        needs_spread=settings.speed.needs_spread,
    )
    with loading():
        policy = load(Path(checkpoint))
        from zoo.server.live_page import LivePage  # imports torch

    if settings.record is not None:
        writer.prepare()
    driver = Driver(
        policy,
        settings.speed,
        settings.steering,
        writer,
        notices,
        record=settings.record is not None,
        checkpoint=checkpoint,
        load=load,
        margin_m=settings.margin,
        track=settings.place,
    )
    token = secrets.token_urlsafe(16) if settings.expose else None
    server = DriveServer(driver, listener, LivePage(driver, token=token), settings.expose)
    url = f"http://{local_name(settings.server[0])}:{server.port}"
    ending = settings.laps, settings.put_back
    client: EmbeddedClient | DrivenSimulator = (
        simulator(driver, settings.place or "", *ending)
        if simulator
        else EmbeddedClient(settings.sim, url, *ending)
    )

    def listening() -> None:
        if token:
            notices.print(
                f"warning: every machine that reaches {url} can connect a simulator and watch; "
                "the page's buttons need the token in the address below"
            )
        notices.print(f"{short_name(Path(checkpoint))}: {view_line(policy)}")
        line = other_car_line(policy.data, settings.sim or "the simulator")
        if line and not settings.world:
            notices.print(line)
        waits = "a simulator; Ctrl-C ends the drive"
        notices.print(f"listening on {url} for {settings.place or waits}")
        page = f"{url}/?token={token}" if token else url
        notices.print(f"open {page} in a browser to watch{' and command' * bool(token)}")
        client.start()

    try:
        server.serve(listening, lambda: stop.asked or client.ended)
    finally:
        failure = client.stop()
        server.close()
        if folder := driver.end(began):
            print_written([folder], ["film" if settings.record else "leaderboard", folder])
    if failure and not stop.asked:  # Ctrl-C can end the simulator first
        raise InputError(failure)
    return folder


class EmbeddedClient:
    """Child process `drivezoo simulator client`.

    Args:
        track: track to drive on; None starts no process.
        url: address of the driver.
        laps: number of laps after which it ends; None drives until `stop`.
        put_back: whether an intervention puts the car back on the centre of the road.
    """

    def __init__(self, track: str | None, url: str, laps: float | None, put_back: bool) -> None:
        self._track, self._options = track, [f"track={track}", f"url={url}", "truth=true"]
        self._options += [f"put_back={str(put_back).lower()}", f"laps={laps or 0}"]
        self._process: subprocess.Popen | None = None

    def start(self) -> None:
        """Start the process, if there is a track."""
        if self._track is not None:
            self._process = start_module("zoo.commands.simulator", "client", *self._options)

    @property
    def ended(self) -> bool:
        """Whether the process has ended by itself."""
        return self._process is not None and self._process.poll() is not None

    def stop(self) -> str:
        """End the process if it runs; return what failed, empty if nothing did."""
        if self._process is None:
            return ""
        if self.ended:
            status = self._process.returncode
            failure = f"the embedded simulator failed, with exit status {status}; see above"
            return failure if status else ""
        end_module(self._process)  # the process closes its film
        return ""


class StopOnSignal(AbstractContextManager):
    """A handler of Ctrl-C and SIGTERM that sets `asked`; a second Ctrl-C interrupts.

    At the end of the `with` block, the signals are handled as before.

    Signals reach the main thread alone: a drive of another thread ends by itself.
    """

    def __init__(self) -> None:
        self.asked, self._before = False, dict[int, Any]()

    def __enter__(self) -> "StopOnSignal":
        for name in ("SIGINT", "SIGTERM", "SIGBREAK"):  # the last on Windows only
            if hasattr(signal, name) and threading.current_thread() is threading.main_thread():
                number = getattr(signal, name)
                self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: object) -> None:
        if self.asked and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.asked = True


def open_port(host: str, port: int, key: str = "port") -> "GreenSocket":
    """Return a listening socket; raise InputError that names the process that holds the port."""
    from zoo.base.machine import port_holder
    from zoo.server.server import listen

    try:
        return listen(host, port)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            holder = port_holder(port)
            by = f"held by {holder}: end it" if holder else "taken: end what holds it"
            reason = f"port {port} is {by}, or add {key}=0 for a free one"
        else:
            reason = f"host={host} port={port}: {error.strerror}; try another"
        raise InputError(reason) from None


def load_warm_policy(
    path: Path,
    threads: int,
    needs_spread: bool = False,
    engine: "Engine" = "auto",
) -> "Policy":
    """Load a policy and call it three times, because the first call is the slowest.

    Args:
        path: checkpoint file.
        threads: threads of the network.
        needs_spread: whether the policy must predict a spread.
        engine: engine that runs the network, see `load_policy`.

    Raises:
        InputError: the checkpoint cannot be loaded, predicts no spread although it must, or is of
            another engine.
    """
    import numpy as np
    import torch

    from datamodules.view import FRAME
    from zoo.base.rig import UDACITY
    from zoo.checkpoints.checkpoint_policy import load_policy
    from zoo.checkpoints.onnx_policy import is_onnx

    if engine == "torch" and is_onnx(path):
        raise InputError(f"engine=torch: {path} runs in onnxruntime; drop it, or drive a .ckpt")
    # torch keeps this number for each thread that loads a policy. Its default, one thread per
    # core, took 128 ms a frame instead of 1.9 ms on four shared cores.
    torch.set_num_threads(threads)
    policy = load_policy(path, threads, engine).in_car(UDACITY)
    for _ in range(3):
        answer = policy(np.zeros((*FRAME, 3), np.uint8), 0.0)
    if needs_spread and answer.spread is None:
        raise InputError(
            f"speed=doubt: {path} predicts no spread of its steering; drive a checkpoint of "
            "model=nvidia_gaussian or of drivezoo doubt, or use speed=pi"
        )
    policy.reset()
    return policy


def view_line(policy: "Policy") -> str:
    """Describe a policy in one line."""
    from zoo.checkpoints.engine import engine_text  # imports torch

    views = [member.view for member in policy.members]
    seen = [f"{view.shape[1]} x {view.shape[0]} {view.colour}" for view in views]
    what = f"{policy.name} of {policy.parameters:,} parameters"
    took = dict.fromkeys(engine_text(member.engine) for member in policy.members)
    return "; ".join([f"{what}, sees {' and '.join(dict.fromkeys(seen))}", *filter(None, took)])


def local_name(host: str) -> str:
    """Return the host name by which a client on this machine reaches a server on `host`."""
    name = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"[{name}]" if ":" in name else name


if __name__ == "__main__":
    drive.run()
