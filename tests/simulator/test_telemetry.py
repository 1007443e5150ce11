"""The original's messages, and the number formats of its C# code."""

import base64
import re

import cv2
import numpy as np
import pytest

from simulator.telemetry import make_telemetry, parse_float, read_steer

FRAME = np.full((160, 320, 3), (200, 100, 50), np.uint8)


def test_telemetry_is_strings_with_degrees_and_four_decimals() -> None:
    message = make_telemetry(FRAME, -0.5, 0.25, 12.34567, decimal_comma=False)
    assert list(message) == ["steering_angle", "throttle", "speed", "image"]
    assert message["steering_angle"] == "-12.5000"
    assert message["throttle"] == "0.2500"
    assert message["speed"] == "12.3457"


def test_its_image_is_the_frame_as_a_jpeg() -> None:
    message = make_telemetry(FRAME, 0, 0, 0, decimal_comma=False)
    data = np.frombuffer(base64.b64decode(message["image"]), np.uint8)
    image = cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.abs(image.astype(int) - FRAME).max() < 5


def test_a_decimal_comma_where_the_locale_has_one() -> None:
    message = make_telemetry(FRAME, 0.1, 0, 9.0, decimal_comma=True)
    for key in ("steering_angle", "throttle", "speed"):
        assert re.fullmatch(r"-?\d+,\d{4}", message[key])
        assert message[key][-5] == ","


def test_truth_adds_numbers_with_four_decimals() -> None:
    message = make_telemetry(FRAME, 0, 0, 0, False, {"time": 1.5, "cte": -0.25})
    assert (message["time"], message["cte"]) == ("1.5000", "-0.2500")


@pytest.mark.parametrize(
    ("text", "comma", "value"),
    [
        ("0.0500", False, 0.05),
        ("-1", False, -1.0),
        (" 1e-2 ", False, 0.01),
        (".5", False, 0.5),
        ("1,000", False, 1000.0),
        ("0,0500", True, 0.05),
        ("0.1000", True, 1000.0),  # the point separates thousands there
        ("0,05", False, 5.0),
        ("nan", False, None),
        ("", False, None),
        ("1.2.3", False, None),
        ("0x10", False, None),
        ("1e39", False, None),
    ],
)
def test_floats_are_parsed_as_csharp_parses_them(text, comma, value) -> None:
    assert parse_float(text, comma) == value


def test_a_steer_is_clamped() -> None:
    assert read_steer({"steering_angle": "-3.0", "throttle": "7"}, False) == (-1.0, 1.0)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"steering_angle": 0.1, "throttle": "0.2"}, "steering_angle is 0.1, expected a string"),
        ({"steering_angle": "0.1"}, "it has no throttle"),
        ({"steering_angle": "nan", "throttle": "0"}, "float.Parse"),
        ([0.1, 0.2], "list, expected one object"),
        (None, "NoneType"),
    ],
)
def test_the_reason_for_discarding_a_reply_is_named(data: object, words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        read_steer(data, False)
