"""What every dialect of `drivezoo simulator client` promises, that of a package among them."""

import base64
import io
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from tests.contracts.outside_package import installed, manual_example
from tests.zoo.simulator.drivers import RawDriver, answering, event
from zoo.base.entry_points import load_named, named_entries
from zoo.base.errors import InputError
from zoo.simulator.client import Client, run_client
from zoo.simulator.command_options import DIALECTS, ClientOptions

NAMES = ("udacity", "mine", *sorted(named_entries(DIALECTS)))


@pytest.fixture(params=NAMES)
def dialect(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    with installed(tmp_path, manual_example("my_dialect.py"), DIALECTS, attribute=":MetricClient"):
        yield request.param


def control_of(dialect: str) -> str:
    return (Client if dialect == "udacity" else load_named(DIALECTS, dialect, Client)).control


def test_a_driver_gets_frames_and_steers(dialect: str) -> None:
    reply = event(control_of(dialect), {"steering_angle": "0.1", "throttle": "1.0"})
    with RawDriver(answering(lambda *_: [reply])) as driver:
        options = ClientOptions(url=driver.url, dialect=dialect, seconds=1.0, quality="simple")
        client = run_client(options, Console(file=io.StringIO()))
    assert client.world.car.speed_mph > 1
    assert not client.counts["discarded"]
    sent = [json.loads(text[2:]) for text in driver.messages[0] if text.startswith("42")]
    assert len(sent) > 5
    for name, data in sent:
        assert "telemetry" in name
        pixels = np.frombuffer(base64.b64decode(data["image"]), np.uint8)
        assert cv2.imdecode(pixels, 1).shape == (160, 320, 3)
        assert float(data["speed"]) >= 0


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("class Mine: pass", "the dialect mine is no zoo.simulator.client.Client; correct"),
        ("import nowhere", "the dialect mine cannot be imported .*install its package again"),
    ],
)
def test_a_package_without_a_client_is_named(code: str, words: str, tmp_path: Path) -> None:
    with (
        installed(tmp_path, code, DIALECTS, attribute=":Mine"),
        pytest.raises(InputError, match=f"^outside_part:Mine: {words}"),
    ):
        run_client(ClientOptions(dialect="mine"), Console())


def test_an_unknown_dialect_gets_one_line() -> None:
    with pytest.raises(InputError, match=r"^maxtwo: no such dialect; "):
        run_client(ClientOptions(dialect="maxtwo"), Console())
