"""Telemetry of every locale, and malformed telemetry."""

import io
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from tests.zoo.server.old_client import telemetry
from tests.zoo.server.serve import picture
from zoo.server.telemetry_message import (
    TelemetryError,
    decimal_sign,
    jpeg_size,
    parse_number,
    read_telemetry,
    reply_values,
)

ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)


@given(st.floats(-100, 100), st.sampled_from([".", ","]))
def test_numbers_are_read_in_both_signs(value: float, sign: str) -> None:
    text = f"{value:.4f}".replace(".", sign)
    assert parse_number(text) == pytest.approx(value, abs=1e-4)
    assert decimal_sign({"steering_angle": text}) == sign


@given(ANY_JSON)
def test_any_json_is_read_or_refused_in_our_own_words(data: object) -> None:
    for value in (data, telemetry(image=data), telemetry(jpeg=b"", speed=data)):
        decimal_sign(value)
        with pytest.raises(TelemetryError):
            read_telemetry(value)


@given(ANY_JSON)
def test_a_number_is_finite_or_none(value: object) -> None:
    number = parse_number(value)
    assert number is None or math.isfinite(number)


@given(st.floats(-1, 1), st.floats(-1, 1), st.sampled_from([".", ","]))
def test_replies_are_strings_of_four_decimals(steering: float, throttle: float, sign: str) -> None:
    for text in reply_values(steering, throttle, sign).values():
        assert text[-5] == sign
        assert -1 <= float(text.replace(",", ".")) <= 1


def test_a_frame_is_what_training_sees() -> None:
    red = read_telemetry(telemetry(jpeg=picture((200, 0, 0)), speed="12,5000", decimal=","))
    assert red.frame.shape == (160, 320, 3)
    assert red.frame[0, 0].tolist() == pytest.approx([200, 0, 0], abs=2)
    assert red.speed_mph == 12.5
    assert math.isnan(red.cross_track_m)
    assert red.oddities == ()


def test_what_is_put_up_with_is_named() -> None:
    odd = read_telemetry(telemetry(jpeg=picture((9, 9, 9), 640, 480), speed="-2.0000", cte=0.4))
    assert odd.frame.shape == (480, 640, 3), "its own size"
    assert [kind for kind, _ in odd.oddities] == ["speed is negative; 0 is used"]
    assert (odd.speed_mph, odd.cross_track_m) == (0, 0.4)


@given(st.integers(1, 700), st.integers(1, 700))
def test_a_size_is_read_from_a_jpegs_head(width: int, height: int) -> None:
    assert jpeg_size(picture((9, 9, 9), width, height)) == (width, height)


@given(st.binary(max_size=64))
def test_bytes_of_any_kind_have_a_size_or_none(tail: bytes) -> None:
    assert jpeg_size(tail) is None
    size = jpeg_size(b"\xff\xd8" + tail)
    assert size is None or all(0 <= side < 1 << 16 for side in size)


@pytest.mark.parametrize("kind", ["GIF", "BMP", "WEBP"])
def test_an_image_that_training_refuses_is_refused_while_driving(kind: str) -> None:
    buffer = io.BytesIO()
    Image.new("RGB", (320, 160)).save(buffer, kind)
    with pytest.raises(TelemetryError, match="the file is no JPEG or PNG"):
        read_telemetry(telemetry(jpeg=buffer.getvalue()))
