"""The client over real sockets: its messages, and its reactions to replies."""

import io
import json
import re
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import groupby
from pathlib import Path

import cv2
import pytest
from rich.console import Console

from tests.zoo.command_runs import start
from tests.zoo.simulator.drivers import ModernDriver, RawDriver, RefusingDriver, steering_driver
from zoo.base.errors import InputError
from zoo.base.key_values import read_options
from zoo.simulator import client as client_module
from zoo.simulator.client import RETRY_S, Client, run_client
from zoo.simulator.command_options import ClientOptions
from zoo.simulator.legacy_socket import LegacySocket
from zoo.simulator.simulated_world import Start, World, open_world

STEER = {"steering_angle": "0.0000", "throttle": "1.0000"}


def recorder() -> Console:
    return Console(record=True, width=400, file=io.StringIO())


def drive(driver: RawDriver | ModernDriver, **options) -> tuple[Client, str]:
    """Drive with a client; return it and its printed lines."""
    console = recorder()
    given = {"seconds": 0.6, "quality": "simple", **options}
    client = run_client(ClientOptions(url=driver.url, **given), console)
    return client, console.export_text()


@pytest.fixture(scope="module")
def driven() -> tuple[RawDriver, Client, str]:
    with RawDriver(steering_driver("-0.5000", "1.0000")) as driver:
        return driver, *drive(driver)


@pytest.fixture(scope="module")
def world() -> World:
    return open_world("lake", quality="simple")


def test_the_handshake_requests_a_websocket_and_eio_4_without_a_connect_packet(driven) -> None:
    request = driven[0].requests[0]
    assert request.startswith("GET /socket.io/?EIO=4&transport=websocket HTTP/1.1")
    assert "origin" not in request.lower()
    assert not any(text.startswith("40") for text in driven[0].messages[0])


def test_it_sends_telemetry_twice_at_first_and_then_once_for_each_reply(driven) -> None:
    """Two loops run: telemetry is two more than the replies."""
    driver, client, _ = driven
    assert client.counts["telemetry"] == client.counts["steer"] + 2
    # The last messages of both loops may be lost when the client closes the connection.
    assert client.counts["telemetry"] - len(driver.telemetry) in (0, 1, 2)


def test_lockstep_drives_one_frame_for_each_reply(driven) -> None:
    assert driven[1].world.frames == driven[1].counts["steer"] == 9


def test_steering_is_obeyed_normalised_and_reported_in_degrees(driven) -> None:
    driver, client, _ = driven
    assert client.world.car.steering == -0.5
    assert json.loads(driver.telemetry[-1][2:])[1]["steering_angle"] == "-12.5000"


def test_the_summary_has_the_drives_figures(driven) -> None:
    pattern = (
        r"0\.\d\d laps in 0\.6 s of simulated time; 9 frames, \d+ per second; 11 telemetry "
        r"messages; connected 1 time; taken over by hand 0 times; cross-track error 0\.\d\d m "
        r"on average, 0\.\d\d m at most; left the road 0 times"
    )
    assert re.search(pattern, driven[2])


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        ('["steer","0.1000","0.2000"]', "it has 2 arguments, expected one object"),
        ('["manual",{},{}]', "it has 2 arguments, expected one object"),
        ('["steer",{"steering_angle":', "not an event with a name"),
    ],
)
def test_a_reply_that_the_original_discards_is_named(world: World, reply: str, words: str) -> None:
    console = recorder()
    with RawDriver(lambda text: ["42" + reply] * text.startswith('42["telemetry"')) as driver:
        link = LegacySocket(driver.url)
        world.reset(0)
        client = Client(world, ClientOptions(), console)
        client.emit(link)
        end_s = time.monotonic() + 0.25
        while time.monotonic() < end_s:
            for event in link.events(0.02):
                client.handle_event(link, *event)
        link.close()
    assert len(driver.telemetry) == 1
    assert world.frames == 0
    printed = console.export_text()
    assert printed.count("\n") == 1
    assert "discarded, as the original" in printed
    assert words in printed


@pytest.mark.parametrize(
    ("options", "reply"),
    [
        ({}, '42["steer",{"steering_angle":"0.0500","throttle":"0.2000"}]'),
        ({"manual": [[0, 9]]}, '42["manual",{}]'),
    ],
)
def test_a_silent_driver_is_reported_with_the_expected_reply(monkeypatch, options, reply) -> None:
    monkeypatch.setattr(client_module, "SILENT_S", 0.2)

    def slow(text: str) -> Iterator[str]:
        if text.startswith('42["telemetry"'):
            time.sleep(0.5 if len(driver.telemetry) == 1 else 0)
            yield reply

    with RawDriver(slow) as driver:
        _, printed = drive(driver, seconds=0.2, **options)
    assert printed.count(f"expected: {reply}") == 1


def test_a_person_who_holds_w_sends_null_and_drives_straight_at_full_throttle() -> None:
    with RawDriver(steering_driver("0.5000", "0.0000")) as driver:
        client, printed = drive(driver, manual=[[0, 0.3], [0.4, 0.5]], seconds=0.9)
    null = [text == '42["telemetry",null]' for text in driver.telemetry]
    # With both loops, each span is answered with nulls, then with telemetry again.
    assert [held for held, _ in groupby(null)] == [True, False, True, False]
    assert client.counts["manual"] == sum(null)
    assert client.world.car.speed_mph > 2
    assert "taken over by hand 2 times" in printed


def test_the_person_drives_the_car_while_w_is_held(world: World) -> None:
    world.reset(0)
    client = Client(world, ClientOptions(manual=[[0.0, 0.4]]), recorder())
    client.command = (0.5, -1.0)
    client.advance()
    assert (world.car.steering, world.car.throttle) == (0.0, 1.0)
    while world.time < 0.4:
        client.advance()
    client.advance()
    assert (world.car.steering, world.car.throttle) == (0.5, -1.0)


def test_a_decimal_comma_is_written_and_read() -> None:
    with RawDriver(steering_driver("0,2000", "1,0000")) as driver:
        client, _ = drive(driver, decimal_comma=True, seconds=0.3)
    telemetry = json.loads(driver.telemetry[-1][2:])[1]
    assert telemetry["steering_angle"] == "5,0000"
    assert re.fullmatch(r"\d+,\d{4}", telemetry["speed"])
    assert client.command == (0.2, 1.0)


def test_the_client_reconnects_at_once_after_dropping_a_connection() -> None:
    with RawDriver(steering_driver()) as driver:
        client, printed = drive(driver, drop_at=0.2)
    assert len(driver.requests) == 2  # one at a time: the first is closed, not leaked
    assert driver.times[1][0] - driver.times[0][-1] < RETRY_S / 2
    assert client.counts["connections"] == 2
    assert "drop_at=0.2" in printed


def test_a_driver_that_refuses_connections_is_tried_after_a_while(monkeypatch) -> None:
    monkeypatch.setattr(client_module, "RETRY_S", 0.2)
    steer = steering_driver()

    def answer(text: str) -> list[str]:
        if len(driver.requests) < 3:
            raise EOFError
        return steer(text)

    with RawDriver(answer) as driver:
        drive(driver, seconds=0.2)
    assert len(driver.requests) == 3
    assert driver.times[2][0] - driver.times[0][0] > 1.9 * 0.2


@pytest.mark.parametrize("disconnects", [False, True])
def test_in_real_time_the_car_drives_without_replies(disconnects: bool) -> None:
    """After its first reply the driver answers nothing more, or disconnects."""
    replies = iter(["42" + json.dumps(["steer", STEER])])

    def answer(text: str) -> Iterator[str]:
        if "telemetry" in text:
            yield from replies
            if disconnects and len(driver.telemetry) == 2:
                driver.listener.close()
                raise EOFError

    with RawDriver(answer) as driver:
        client, printed = drive(driver, clock="realtime")
    assert client.world.car.speed_mph > 4
    assert ("disconnected" in printed) == disconnects


def test_in_real_time_each_reply_is_answered_at_the_next_frame() -> None:
    with RawDriver(steering_driver()) as driver:
        client, _ = drive(driver, clock="realtime", seconds=1.0)
    assert client.world.frames == 15
    assert 0 < client.counts["telemetry"] <= 2 * 15 + 2, "two loops of 15 a second at most"


def test_ctrl_c_prints_a_summary_and_refusals_are_tried_again_slowly(tmp_path: Path) -> None:
    words = ("zoo.commands.simulator", "client", "quality=simple")
    with RefusingDriver() as driver:
        process = start(tmp_path, *words, f"url={driver.url}")
        first = [process.stdout.readline() for _ in range(2)]
        time.sleep(1.2)
        process.send_signal(signal.SIGINT)
        rest = process.communicate(timeout=10)[0].splitlines()
    assert first[1].startswith(f"waiting for a driver at {driver.url}; start it with: drivezoo")
    assert "HTTP 400" in first[1]
    assert rest[0] == "stopped"
    assert rest[1].startswith("0.00 laps in 0.0 s")
    assert len(rest) == 2
    assert process.returncode == 0
    assert 2 <= len(driver.times) <= 4
    assert driver.left_open == 0


def test_truth_adds_figures_to_telemetry_and_a_film_has_every_frame(tmp_path: Path) -> None:
    path = tmp_path / "lap.mp4"
    with RawDriver(steering_driver()) as driver:
        client, _ = drive(driver, truth=True, film=str(path))
    message = json.loads(driver.telemetry[-2][2:])[1]
    assert float(message["time"]) > 0.2
    assert abs(float(message["cte"])) < 1
    assert message["lane"] == "3.2000"
    assert message["wall"] == message["put_back"] == "0.0000"
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == client.world.frames == 9
    assert video.get(cv2.CAP_PROP_FPS) == 15


def put_back(options: ClientOptions, world: World, reply: dict) -> Client:
    """Return a client off the lake's road that has handled a reply."""
    world.reset(0)
    world.put_back(Start(100, cte=5.0, speed_mph=9))
    client = Client(world, options, recorder())
    with RawDriver(steering_driver()) as driver, closing(LegacySocket(driver.url)) as link:
        client.frame()
        client.handle_event(link, "steer", reply)
    return client


def test_a_reply_puts_the_car_back_on_the_road_with_put_back(world: World) -> None:
    reply = {**STEER, "put_back": "12,0000"}
    client = put_back(ClientOptions(truth=True, put_back=True, decimal_comma=True), world, reply)
    assert (client.frame() == world.frame()).all(), "the frame from off the road was kept"
    assert world.cte == pytest.approx(0, abs=1e-3)
    assert world.place.distance == pytest.approx(100, abs=0.5)
    assert world.car.speed_mph == pytest.approx(12)
    assert client.counts["put back"] == 1


def test_rich_markup_in_a_line_is_printed_unchanged(world: World) -> None:
    console = recorder()
    Client(world, ClientOptions(), console).print_once("[brightness] [/red] :car:")
    assert console.export_text() == "[brightness] [/red] :car:\n"


def test_a_reply_puts_nothing_back_by_default(world: World) -> None:
    put_back(ClientOptions(truth=True), world, {**STEER, "put_back": "12.0000"})
    assert abs(world.cte) > 4


def test_the_modern_protocol_drives_with_python_socketio() -> None:
    with ModernDriver(STEER) as driver:
        client, printed = drive(driver, protocol="modern", manual=[[0, 0.2]])
    assert driver.telemetry[0] == [None]  # one argument, null, as from the original
    assert set(driver.telemetry[-1][0]) == {"steering_angle", "throttle", "speed", "image"}
    assert client.counts["manual"] == 3
    assert client.counts["steer"] == 6
    assert client.world.car.speed_mph > 4
    assert "connected 1 time; taken over by hand 1 time" in printed


def test_spans_of_seconds_may_be_whole_numbers_on_the_command_line() -> None:
    assert read_options(ClientOptions, ["manual=[[5,7],[20,21.5]]"]).manual == ([5, 7], [20, 21.5])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"protocol": "old"}, "protocol=old: must be legacy or modern"),
        ({"manual": [[3.0, 1.0]]}, "manual: must be pairs"),
        ({"manual": [5, 7]}, "manual: must be pairs"),
        ({"url": "nowhere", "protocol": "modern"}, "url=nowhere: must be like"),
        ({"film": "lap.avi"}, "must end in .mp4"),
    ],
)
def test_a_wrong_option_is_named(options: dict, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        run_client(ClientOptions(**{"seconds": 0.1, **options}), Console(quiet=True))
