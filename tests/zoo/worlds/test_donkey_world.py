"""A Donkeycar simulator as a world: what a simulator that fails is reported as."""

import base64
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import cv2
import numpy as np
import pytest

from zoo.base.errors import InputError
from zoo.worlds import donkey_world
from zoo.worlds.donkey_world import DonkeyWorld
from zoo.worlds.scenario import Scenario

Change = Callable[[int, dict], dict | None]


def telemetry(number: int, size: tuple[int, int] = (120, 160)) -> dict:
    jpeg = cv2.imencode(".jpg", np.full((*size, 3), 90, np.uint8))[1].tobytes()
    place = dict.fromkeys(("pos_x", "pos_y", "pos_z", "cte", "activeNode", "steering_angle"), 0.0)
    image = base64.b64encode(jpeg).decode()
    return {"msg_type": "telemetry", "time": number / 20, "speed": 1, "image": image, **place}


@contextmanager
def simulator(change: Change) -> Iterator[str]:
    """Run a small simulator whose telemetry is changed; yield its address."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = listener.accept()
        with connection:
            loaded = (
                {"msg_type": "scene_selection_ready"},
                {"msg_type": "scene_names", "scene_names": ["oval"]},
                {"msg_type": "car_loaded"},
                {"msg_type": "protocol_version", "version": "2"},
            )
            messages = [*loaded, *(change(number, telemetry(number)) for number in range(10))]
            with suppress(OSError):  # the client has left
                for message in messages:
                    if message is None:
                        return
                    connection.sendall(json.dumps(message).encode() + b"\n")
                while connection.recv(65_536):
                    pass

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield f"127.0.0.1:{listener.getsockname()[1]}/oval"
    listener.close()


def step_through(address: str) -> None:
    world = DonkeyWorld(address)
    try:
        world.reset(Scenario(address, world="donkey"))
        for _ in range(8):
            world.step(0.1, 0.2)
    finally:
        world.close()


def test_numbers_may_have_a_decimal_comma() -> None:
    def with_commas(number: int, message: dict) -> dict:
        return message | {"speed": "1,5", "time": f"{number / 20:.2f}".replace(".", ",")}

    with simulator(with_commas) as address:
        step_through(address)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda number, message: None if number == 4 else message, "closed|reset|Broken pipe"),
        (lambda number, message: message | {"speed": "NaN"}, "speed is 'NaN', no number"),
        (lambda number, message: message | {"image": "AAAA"}, "image: "),
        (lambda number, message: telemetry(number, (60, 80)) if number > 3 else message, "changed"),
    ],
)
def test_a_simulator_that_fails_is_named(change: Change, reason: str) -> None:
    with simulator(change) as address, pytest.raises(InputError, match=reason) as caught:
        step_through(address)
    assert address in str(caught.value)


def test_a_silent_simulator_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(donkey_world, "SILENT_S", 0.5)
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        pytest.raises(InputError, match="the simulator failed: timed out"),
    ):
        DonkeyWorld(f"127.0.0.1:{listener.getsockname()[1]}/oval")


@pytest.mark.parametrize("address", ["", "a b", "host:99999999/x"])
def test_an_address_that_is_none_is_named(address: str) -> None:
    with pytest.raises(InputError, match="HOST:PORT/SCENE"):
        DonkeyWorld(address)
