"""The client of 2016 and a current one, on real sockets."""

import socket
import threading

import pytest
import socketio

from tests.zoo.server.old_client import OldClient, telemetry
from tests.zoo.server.serve import RED, Served, picture
from zoo.server.fast_socket import EagerSocket

DIM = picture((51, 0, 0))  # steering 0.1961


def test_a_client_that_never_connects_to_a_namespace_is_driven(driver: Served) -> None:
    with OldClient(driver.port) as client:
        assert client.status == 101
        client.check_steered()
        assert client.packets[1].startswith("40{"), "as if it had asked to be connected"


def test_its_pings_are_answered_before_and_after_telemetry(driver: Served) -> None:
    with OldClient(driver.port) as client:
        assert client.packet().startswith("0{")
        client.send("2")
        assert client.packet() == "3"
        client.check_steered()
        client.send("2")
        assert client.packet() == "3"


def test_replies_keep_the_order_of_a_burst(driver: Served) -> None:
    shades = [20, 220, 60, 180, 100, 140, 30, 200]
    with OldClient(driver.port) as client:
        for shade in shades:
            client.telemetry(jpeg=picture((shade, 0, 0)))
        replies = [float(client.reply()[1]["steering_angle"]) for _ in shades]
        assert client.silent_for(0.3), "one reply for each telemetry"
    assert replies == pytest.approx([shade / 255 for shade in shades], abs=0.02)


def modern_drive(port: int, replies: list, count: int, **values: object) -> None:
    """Drive `count` frames by a current client, which changes from polling to a WebSocket."""
    client = socketio.SimpleClient()
    client.connect(f"http://127.0.0.1:{port}")
    for _ in range(count):
        client.emit("telemetry", telemetry(**values))
        replies.append(client.receive(10))
    client.disconnect()


def test_both_protocols_at_once_each_get_their_own_replies(driver: Served) -> None:
    replies: list = []
    modern = threading.Thread(target=lambda: modern_drive(driver.port, replies, 40, jpeg=DIM))
    with OldClient(driver.port) as old:
        modern.start()
        for _ in range(60):
            old.telemetry(jpeg=RED, decimal=",")
            assert old.reply() == ("steer", {"steering_angle": "0,8000", "throttle": "0,2000"})
        modern.join(10)
        assert old.silent_for(0.2)
    assert len(replies) == 40
    assert {reply[1]["steering_angle"] for reply in replies} == {"0.1961"}


@pytest.mark.parametrize("connects", [True, False])
def test_a_client_that_has_disconnected_is_not_driven(driver: Served, connects: bool) -> None:
    with OldClient(driver.port) as client:
        if connects:
            client.send("40")
            client.check_steered()
        client.send("41")
        client.telemetry(jpeg=RED)
        assert client.silent_for(0.3)


@pytest.mark.parametrize("decimal", [".", ","])
def test_it_answers_in_the_numbers_that_it_is_asked_in(driver: Served, decimal: str) -> None:
    with OldClient(driver.port) as client:
        client.telemetry(jpeg=RED, decimal=decimal)
        assert client.reply()[1]["throttle"] == f"0{decimal}2000"
        client.telemetry(jpeg=b"rubbish", decimal=decimal)
        assert client.reply()[1]["steering_angle"] == f"0{decimal}8000"
        client.emit("telemetry", [])
        assert client.reply()[1]["steering_angle"] == f"0{decimal}8000"


@pytest.mark.skipif(not hasattr(socket, "TCP_QUICKACK"), reason="Linux alone has it")
def test_each_read_is_acknowledged_at_once_and_replies_are_not_held_back() -> None:
    """Check a rate above 25 frames per second, the limit of delayed acknowledgements."""
    options: list[tuple[int, int, int]] = []

    class Noted(socket.socket):
        def setsockopt(self, *option: int) -> None:
            options.append(option)
            super().setsockopt(*option)

    with socket.create_server(("127.0.0.1", 0)) as listener, Noted() as ours:
        ours.connect(listener.getsockname())
        eager = EagerSocket(ours, hold=lambda _: None)
        with listener.accept()[0] as client:
            for sent in (b"a", b"b"):
                client.sendall(sent)
                assert eager.recv(1) == sent
    quick = (socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
    assert options == [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1), quick, quick]
