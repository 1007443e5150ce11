"""Each telemetry gets its reply whatever clients send, and the driver keeps running."""

import base64
import contextlib
import json
import math
import time
from pathlib import Path

import pytest

from tests.zoo.page_requests import ask
from tests.zoo.server.old_client import TEXT, OldClient, check_drives, closed, telemetry
from tests.zoo.server.scans import png_bomb
from tests.zoo.server.serve import BLACK, FINE, NOTHING, RED, WHITE, Served, picture, served

AGAIN = ("steer", {"steering_angle": "0.8000", "throttle": "-0.2000"})


def event(*arguments: object) -> str:
    return "42" + json.dumps(["telemetry", *arguments])


RUBBISH = {
    "list": event([1, 2]),
    "string": event("drive!"),
    "number": event(7),
    "empty object": event({}),
    "no image": event(telemetry(image=None)),
    "image is a list": event(telemetry(image=[1])),
    "bad base64": event(telemetry(image="%%%%a")),
    "not a picture": event(telemetry(jpeg=b"not a picture")),
    "truncated JPEG": event(telemetry(jpeg=RED[:-200])),
    "10 MB": event(telemetry(image="A" * 10_000_000)),
    "no JSON": '42["telemetry",{"speed":',
    "unpaired": '42["telemetry",{"speed":"\\ud800"}]',
    "deep": '42["telemetry",' + "[" * 200_000,
    "long integer": '42["telemetry",{"speed":' + "9" * 10_000 + "}]",
    "not UTF-8": b'42["telemetry",{"speed":"\xff\xfe',
    "huge picture": event(telemetry(jpeg=png_bomb(20_000, 5_000))),
    "the policy raises": event(telemetry(jpeg=picture(BLACK), speed="9.0000")),
    "the policy is NaN": event(telemetry(jpeg=picture(WHITE), speed="9.0000")),
}


@pytest.mark.parametrize("name", RUBBISH)
def test_rubbish_is_answered_once_and_the_car_goes_on(driver: Served, name: str) -> None:
    with OldClient(driver.port, timeout_s=10) as client:
        client.send(RUBBISH[name])
        first = client.reply()[1]
        assert float(first["steering_angle"]) == 0
        assert float(first["throttle"]) <= 0
        client.check_steered(speed="9.0000")
        client.send(RUBBISH[name])
        assert client.reply() == AGAIN, "steer as before, brake gently"
        client.check_steered(speed="9.0000")
        assert client.silent_for(0.05)


# A number in JSON that only Python reads, and base64 with line breaks.
@pytest.mark.parametrize(
    "values", [{"jpeg": RED, "speed": math.nan}, {"image": base64.encodebytes(RED).decode()}]
)
def test_what_other_simulators_may_send_is_driven(driver: Served, values: dict) -> None:
    with OldClient(driver.port) as client:
        client.telemetry(**values)
        assert client.reply() == FINE


def test_ten_megabytes_in_one_frame_are_answered(driver: Served) -> None:
    with OldClient(driver.port) as client:
        client.send_frame(TEXT, RUBBISH["10 MB"].encode())
        assert client.reply() == NOTHING


@pytest.mark.parametrize(
    "packet", ["", "9", "4", "47", "45", "4" + "9" * 300, "42[", "42[]", "42{}"]
)
def test_what_is_no_telemetry_gets_no_reply(driver: Served, packet: str) -> None:
    with OldClient(driver.port) as client:
        client.check_steered()
        client.send(packet)
        with contextlib.suppress(ConnectionError):  # it may be sent away
            assert client.silent_for(0.1)
    check_drives(driver.port)


def test_200_connections_at_once_are_all_served(driver: Served) -> None:
    clients = [OldClient(driver.port, timeout_s=20) for _ in range(200)]
    for client in clients:
        client.telemetry(jpeg=RED)
        client.telemetry(jpeg=RED)
    for client in clients:
        assert client.reply() == client.reply() == FINE
        client.socket.close()


def test_a_client_that_comes_and_goes_100_times_a_second_is_put_up_with(driver: Served) -> None:
    with OldClient(driver.port) as steady:
        for turn in range(200):
            client = OldClient(driver.port)
            if turn % 2:
                client.telemetry(jpeg=RED)
            client.socket.close()
            if turn % 20 == 0:
                steady.check_steered()
    check_drives(driver.port)


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ("", 101),
        ("Origin: http://127.0.0.1:{port}\r\n", 101),
        ("Origin: http://example.org\r\n", 403),
        ("Origin: null\r\n", 403),
        ("Origin: http://example.org:{port}\r\nX-Forwarded-Host: example.org:{port}\r\n", 403),
    ],
)
def test_only_pages_of_this_server_may_connect(driver: Served, headers: str, status: int) -> None:
    with OldClient(driver.port, headers.format(port=driver.port)) as client:
        assert client.status == status


def test_a_site_that_gives_its_name_our_address_is_refused(driver: Served) -> None:
    for path in ("/", "/socket.io/?EIO=4&transport=polling"):
        host = f"rebound.example.org:{driver.port}"
        assert ask(driver.port, "GET", path, Host=host)[0] == 403


def test_refused_connections_are_closed_so_that_they_cannot_fill_the_server(driver: Served) -> None:
    clients = [OldClient(driver.port, "Origin: null\r\n") for _ in range(300)]
    assert all(closed(client.socket) for client in clients)
    check_drives(driver.port)
    for client in clients:
        client.socket.close()


def test_a_full_disk_is_said_once_and_driving_goes_on(tmp_path: Path) -> None:
    import resource

    with served(tmp_path / "drive") as process:
        with OldClient(process.port) as client:
            client.check_steered()
            time.sleep(0.3)
            # No file may grow, as on a full disk.
            resource.prlimit(process.process.pid, resource.RLIMIT_FSIZE, (0, -1))
            for shade in range(20, 60):
                client.telemetry(jpeg=picture((shade, 0, 0)))
                assert client.reply()[0] == "steer"
        assert process.stop() == 0
    lines = [line for line in process.lines if "driving continues: " in line]
    assert len(lines) == 1, process.lines
    assert len((tmp_path / "drive" / "driving_log.csv").read_text().splitlines()) == 1
    assert len(list((tmp_path / "drive" / "IMG").iterdir())) == 1
