"""Small images that take long to decode: the driver answers without decoding them."""

import cv2
import numpy as np
import pytest

from tests.zoo.drive.old_client import OldClient, telemetry
from tests.zoo.drive.scans import SCANS, many_scans, png_bomb
from tests.zoo.drive.serve import Served, picture
from zoo.drive import telemetry_message as telemetry_module
from zoo.drive.telemetry_message import MAX_IMAGE_BYTES, MAX_SCANS, TelemetryError, read_telemetry

RED = picture((204, 0, 0))  # steering 0.8
FINE = {"steering_angle": "0.8000", "throttle": "0.2000"}
AGAIN = {"steering_angle": "0.8000", "throttle": "-0.2000"}


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
def test_an_expensive_image_is_answered_as_invalid(driver: Served, name: str) -> None:
    with OldClient(driver.port) as client:
        client.telemetry(jpeg=RED, speed="9.0000")
        assert client.reply() == ("steer", FINE)
        client.telemetry(jpeg=HOSTILE[name][0], speed="9.0000")
        assert client.reply() == ("steer", AGAIN)


@pytest.mark.parametrize("name", HOSTILE)
def test_it_is_refused_before_it_is_decoded(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(telemetry_module, "decode_image", None)
    jpeg, words = HOSTILE[name]
    with pytest.raises(TelemetryError, match=words) as error:
        read_telemetry(telemetry(jpeg=jpeg))
    assert "image" in error.value.kind


@pytest.mark.parametrize(("width", "height"), [(640, 480), (1280, 720)])
@pytest.mark.parametrize("kind", [".jpg", ".png"])
def test_other_simulators_images_are_decoded(width: int, height: int, kind: str) -> None:
    noise = np.random.default_rng(0).integers(0, 60, (height, width, 3), np.uint8)
    smooth = cv2.blur(noise, (15, 15))
    image = cv2.imencode(kind, smooth)[1].tobytes()
    assert len(image) < MAX_IMAGE_BYTES
    assert read_telemetry(telemetry(jpeg=image)).frame.shape == (160, 320, 3)


def test_a_plain_progressive_jpeg_is_decoded() -> None:
    assert read_telemetry(telemetry(jpeg=many_scans(SCANS))).frame.shape == (160, 320, 3)
