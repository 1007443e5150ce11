"""Checks of the inputs: whether a recording and a checkpoint can be used, and a round trip."""

from __future__ import annotations

import re
import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import compress
from typing import TYPE_CHECKING

from zoo.base.child_process import end_module, start_module
from zoo.base.terminal import command_line
from zoo.server.machine_checks import FAULT, OK, WARNING, Finding

if TYPE_CHECKING:
    from zoo.checkpoints.policy_base import Policy
    from zoo.simulator.legacy_socket import LegacySocket

SLOW_MS = 1000 / 60  # the original simulator sends up to 60 images per second
TRIALS, IMAGES = 15, 50
TIMEOUT_S = 30.0
FRAMES = 20  # of the round trip


def check_checkpoint(path: str, recording: str | None = None) -> Iterator[Finding]:
    """Check that a checkpoint loads; report its input and its time for a frame of a drive."""
    import numpy as np

    from zoo.base.rig import UDACITY
    from zoo.checkpoints.checkpoint_policy import load_policy
    from zoo.driving.run_drives import one_thread
    from zoo.server.drive_settings import DriveSettings

    policy = load_policy(path, engine=DriveSettings.engine).in_car(UDACITY)  # only its time counts
    name = policy.config.get("model", {}).get("name") or policy.name
    yield Finding(OK, "checkpoint", f"{path}: {name}, {policy.parameters:,} parameters")
    inputs = dict.fromkeys((member.view, member.takes_speed) for member in policy.members)
    for view, takes_speed in inputs:
        seen = f"{view.shape[1]} x {view.shape[0]} {view.colour}"
        speed = " and the speed" if takes_speed else ""
        yield Finding(OK, "input", f"{seen}{speed}; without {view.crop_text}")
    yield _trained_on(policy, recording)

    frame = np.full((*policy.view.frame, 3), 128, np.uint8)
    times_ms = []
    with one_thread():  # as `drive` does; torch's default is slower
        for _ in range(TRIALS):
            began = time.perf_counter()
            policy(frame, 9.0)
            times_ms.append(1000 * (time.perf_counter() - began))
    took_ms = statistics.median(times_ms)
    result = f"{took_ms:.1f} ms per frame, {1000 / took_ms:.0f} frames per second"
    if took_ms > SLOW_MS:
        fix = "train a smaller model: drivezoo list models"
        yield Finding(WARNING, "speed", f"{result}; a simulator sends up to 60", fix)
    else:
        yield Finding(OK, "speed", result)


def _trained_on(policy: Policy, recording: str | None) -> Finding:
    from datamodules.recording_format import read_recordings
    from zoo.base.errors import InputError

    data = policy.data
    fingerprint, config = data.get("fingerprint"), policy.config
    if fingerprint is None or config.get("trainer", {}).get("max_epochs") == 0:  # from elsewhere
        return Finding(OK, "trained on", "not known")
    root = config.get("data", {}).get("root")
    result = f"{root}, {data.get('rows', 0):,} rows, fingerprint {fingerprint}"
    with suppress(InputError):
        if recording is not None:
            same = read_recordings(recording, on_bad_image="skip").fingerprint() == fingerprint
            result += f"; {'' if same else 'not '}the same as this recording"
    return Finding(OK, "trained on", result)


def check_recording(folder: str) -> Iterator[Finding]:
    """Check that a recording's log can be read, and a sample of its images."""
    import numpy as np

    from datamodules.image import read_image
    from datamodules.recording_format import read_recordings

    recording = read_recordings(folder, on_bad_image="skip")
    present = [any(path is not None for path in paths) for paths in recording.images.T]
    cameras = ", ".join(compress(("centre", "left", "right"), present))
    yield Finding(OK, "recording", f"{folder}: {len(recording):,} rows, cameras {cameras}")
    bad = list(recording.bad_images)
    rows = np.unique(np.linspace(0, len(recording) - 1, IMAGES).astype(int))
    for row in rows:
        try:
            read_image(recording.images[row, 0])
        except (OSError, ValueError) as error:
            bad.append(f"{recording.place(row)}: {recording.images[row, 0]}: {error}")
    if bad:
        result = f"{len(bad):,} or more bad images: {bad[0]}"
        fix = f"list them with {command_line(['drivezoo', 'check', folder])}; train with "
        yield Finding(WARNING, "images", result, f"{fix}data.on_bad_image=skip")
    else:
        yield Finding(OK, "images", f"a sample of {len(rows)} can be read")


def check_round_trip(checkpoint: str) -> Iterator[Finding]:
    """Start `drivezoo drive` with a checkpoint, and send it grey images."""
    what = "round trip"
    fix = f"start it yourself to see its output: {command_line(['drivezoo', 'drive', checkpoint])}"
    with tempfile.TemporaryDirectory() as folder:
        process = start_module(
            "zoo.commands.drive",
            checkpoint,
            "drive.port=0",
            f"drive.record={folder}/drive",
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
        )
        try:
            url, last = _wait_for_url(process)
            if url is None:
                yield Finding(FAULT, what, f"the driver did not start, it printed: {last}", fix)
                return
            times_ms, steer = _drive(url)
            result = f"{FRAMES} images as the original sends them, each answered"
            took = f"{statistics.median(times_ms):.1f} ms"
            yield Finding(OK, what, f"{result} in {took} (median), steering {steer:+.3f}")
        except (OSError, ValueError, TimeoutError) as error:
            yield Finding(FAULT, what, f"the driver does not answer: {error}", fix)
        finally:
            end_module(process)


def _drive(url: str) -> tuple[list[float], float]:
    """Return the milliseconds from each telemetry to its reply, and the last steering.

    Raises:
        TimeoutError: the driver sent no reply.
        ValueError: the original simulator would not accept the reply.
    """
    import numpy as np

    from datamodules.view import FRAME
    from zoo.simulator.legacy_socket import LegacySocket
    from zoo.simulator.telemetry import make_telemetry, read_steer

    frame = np.full((*FRAME, 3), 128, np.uint8)
    client = LegacySocket(url)
    times_ms, steering = [], 0.0
    try:
        for _ in range(FRAMES):
            began = time.perf_counter()
            client.emit("telemetry", make_telemetry(frame, 0.0, 0.0, 9.0, decimal_comma=False))
            steering, _ = read_steer(_next_steer(client), decimal_comma=False)
            times_ms.append(1000 * (time.perf_counter() - began))
    finally:
        client.close()
    return times_ms, steering


def _next_steer(client: LegacySocket) -> object:
    end_s = time.monotonic() + TIMEOUT_S / 3
    while time.monotonic() < end_s:
        for name, argument in client.events(0.2):
            if name == "steer":
                return argument
    raise TimeoutError("no steer event received")


def _wait_for_url(process: subprocess.Popen) -> tuple[str | None, str]:
    """Return the URL that the driver prints, None without one, and the last line."""
    timer = threading.Timer(TIMEOUT_S, process.kill)
    timer.start()
    last = "nothing"
    try:
        for line in process.stdout or ():
            last = line.strip() or last
            if match := re.search(r"listening on (http://\S+?)[;\s]", line):
                return match[1], last
    finally:
        timer.cancel()
    return None, last
