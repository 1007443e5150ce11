"""Clients that flood the driver with messages, images or requests: a simulator still drives."""

import contextlib
import threading
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.zoo.server.old_client import (
    CONTINUATION,
    TEXT,
    WS_PING,
    OldClient,
    masked_frame,
    telemetry,
)
from tests.zoo.server.scans import SCANS, many_scans, png_bomb
from tests.zoo.server.serve import RED, Served, picture, served
from zoo.server import telemetry_message as telemetry_module
from zoo.server.telemetry_message import MAX_IMAGE_BYTES, MAX_SCANS, TelemetryError, read_telemetry

ANSWERS = 40
FLOODS = {
    "events": masked_frame(TEXT, b'42["x"]'),
    "connects": masked_frame(TEXT, b"40"),
    "connects to a namespace": masked_frame(TEXT, b"40/x,"),
    "PINGs": masked_frame(TEXT, b"2"),
    "PONGs": masked_frame(TEXT, b"3"),
    "WebSocket PINGs": masked_frame(WS_PING, b""),
    "fragments of one byte": masked_frame(CONTINUATION, b"x", last=False),
    "telemetry": masked_frame(TEXT, b'42["telemetry",{}]'),
}


class Flood(threading.Thread):
    """A client that sends one frame again and again until the driver closes its connection.

    Args:
        port: port of the driver.
        frame: frame to send.
        reads: whether it reads what the driver sends.
    """

    def __init__(self, port: int, frame: bytes, reads: bool = True) -> None:
        super().__init__(daemon=True)
        self.client = OldClient(port)
        if frame[0] & 15 == CONTINUATION:
            self.client.send_frame(TEXT, b"4", last=False)
        self.client.socket.settimeout(None)
        self._sent = frame * (1 << 14)
        if reads:
            threading.Thread(target=self._read, daemon=True).start()

    def run(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                self.client.socket.sendall(self._sent)

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while self.client.socket.recv(1 << 16):
                pass


@contextlib.contextmanager
def flooded(port: int, frame: bytes, reads: bool = True) -> Iterator[Flood]:
    flood = Flood(port, frame, reads)
    flood.start()
    try:
        yield flood
    finally:
        flood.client.socket.close()


@pytest.mark.parametrize(("kind", "reads"), [*product(FLOODS, [True]), ("telemetry", False)])
def test_a_simulator_drives_beside_a_flood(driver: Served, kind: str, reads: bool) -> None:
    with OldClient(driver.port, timeout_s=20) as car, flooded(driver.port, FLOODS[kind], reads):
        for number in range(ANSWERS):
            car.check_steered(speed=f"{number}.0000")


@pytest.mark.parametrize("kind", ["PINGs", "fragments of one byte", "WebSocket PINGs"])
def test_a_flood_of_small_frames_is_closed_and_reported(tmp_path: Path, kind: str) -> None:
    with served(tmp_path / "drive") as driver:
        with flooded(driver.port, FLOODS[kind]) as flood:
            flood.join(60)
            assert not flood.is_alive()
        driver.stop()
        (line,) = [row for row in driver.lines if "connection closed" in row and "printed" in row]
        assert "127.0.0.1" in line
        assert "2,000" in line


@pytest.mark.parametrize("reads", [True, False])
def test_ctrl_c_ends_a_driver_under_a_flood(tmp_path: Path, reads: bool) -> None:
    with (
        served(tmp_path / "drive") as driver,
        OldClient(driver.port) as simulator,
        flooded(driver.port, FLOODS["connects"], reads),
    ):
        simulator.telemetry()
        assert driver.stop() == 0


def test_a_client_that_reads_no_replies_is_disconnected(tmp_path: Path) -> None:
    """Each request of a namespace that does not exist is answered."""
    with (
        served(tmp_path / "drive") as driver,
        flooded(driver.port, FLOODS["connects to a namespace"], reads=False) as flood,
    ):
        flood.join(60)
        assert not flood.is_alive()


def padded(size: int) -> bytes:
    """Return a JPEG that comments extend to a size."""
    comment = b"\xff\xfe\xff\xff" + bytes(65533)
    return RED[:2] + comment * (size // len(comment) + 1) + RED[2:]


HOSTILE = {
    "10,796 scans": (many_scans(10_796), "scans"),
    "one scan too many": (many_scans(MAX_SCANS + 1), "scans"),
    "4096 x 4096 JPEG": (picture((204, 0, 0), 4096, 4096), "4096 x 4096"),
    "4096 x 4096 PNG": (png_bomb(4096, 4096), "4096 x 4096"),
    "1.1 MB": (padded(1_100_000), "bytes"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_an_expensive_image_is_not_decoded(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(telemetry_module, "decode_image", None)
    jpeg, words = HOSTILE[name]
    with pytest.raises(TelemetryError, match=words) as error:
        read_telemetry(telemetry(jpeg=jpeg))
    assert "image" in error.value.kind


@pytest.mark.parametrize(("width", "height"), [(640, 480), (1280, 720)])
@pytest.mark.parametrize("kind", [".jpg", ".png"])
def test_other_simulators_images_are_decoded(width: int, height: int, kind: str) -> None:
    noise = np.random.default_rng(0).integers(0, 60, (height, width, 3), np.uint8)
    image = cv2.imencode(kind, cv2.blur(noise, (15, 15)))[1].tobytes()
    assert len(image) < MAX_IMAGE_BYTES
    assert read_telemetry(telemetry(jpeg=image)).frame.shape == (height, width, 3)


def test_a_plain_progressive_jpeg_is_decoded() -> None:
    frame = read_telemetry(telemetry(jpeg=many_scans(SCANS))).frame
    assert (frame.ndim, frame.shape[2]) == (3, 3)
