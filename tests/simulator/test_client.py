"""The autonomous mode: what it sends and obeys, with real sockets."""

import io
import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import pytest
from rich.console import Console

from simulator import client as client_module
from simulator.client import RETRY_S, Client, ClientOptions, run_client
from simulator.command_line import read_options
from simulator.errors import SimulatorError
from simulator.legacy_socket import LegacySocket
from simulator.world import Start, World, open_world
from tests.simulator.drivers import ModernDriver, RawDriver, RefusingDriver, steering_driver

STEER = {"steering_angle": "0.0000", "throttle": "1.0000"}


def recorder() -> Console:
    return Console(record=True, width=400, file=io.StringIO())


def drive(driver: RawDriver | ModernDriver, **options) -> tuple[Client, str]:
    """A client's drive, and what it told the person."""
    console = recorder()
    given = {"seconds": 0.6, "quality": "simple", **options}
    client = run_client(ClientOptions(url=driver.url, **given), console)
    return client, console.export_text()


@pytest.fixture(scope="module")
def talked() -> tuple[RawDriver, Client, str]:
    with RawDriver(steering_driver(throttle="1.0000")) as driver:
        return driver, *drive(driver)


@pytest.fixture(scope="module")
def world() -> World:
    return open_world("lake", quality="simple")


def test_the_handshake_is_a_websocket_that_says_eio_4(talked) -> None:
    request = talked[0].requests[0]
    assert request.startswith("GET /socket.io/?EIO=4&transport=websocket HTTP/1.1")
    assert "origin" not in request.lower()


def test_it_never_sends_the_connect_packet(talked) -> None:
    assert not any(text.startswith("40") for text in talked[0].messages[0])


def test_it_announces_itself_twice_and_then_answers_once_each(talked) -> None:
    """Two loops: telemetry is two more than the replies that were obeyed."""
    driver, client, _ = talked
    assert client.counts["telemetry"] == client.counts["steer"] + 2
    # The last of both loops may be on their way when the client has driven enough, and hangs up.
    assert client.counts["telemetry"] - len(driver.telemetry) in (0, 1, 2)


def test_a_picture_travels_in_many_fragments(talked) -> None:
    lengths = [length for final, opcode, _, length in talked[0].frames[0] if not final]
    assert len(lengths) > 8 * len(talked[0].telemetry)
    assert set(lengths) == {1016}


def test_lock_step_is_a_frame_for_each_reply(talked) -> None:
    assert talked[1].world.frames == talked[1].counts["steer"] == 9


def test_a_driver_that_accelerates_moves_the_car(talked) -> None:
    assert talked[1].world.car.speed_mph > 4


def test_steering_is_obeyed_normalised_and_reported_in_degrees() -> None:
    with RawDriver(steering_driver("-0.5000")) as driver:
        client, _ = drive(driver)
    assert client.world.car.steering == -0.5
    assert json.loads(driver.telemetry[-1][2:])[1]["steering_angle"] == "-12.5000"


def test_the_summary_says_how_it_went(talked) -> None:
    pattern = (
        r"0\.\d\d laps in 0\.6 s of simulated time; 9 frames, \d+ a second; 11 telemetry in "
        r"1 connections; 0 times taken over by hand; off centre 0\.\d\d m on average, "
        r"0\.\d\d m at most; 0 times off the road"
    )
    assert re.search(pattern, talked[2])


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        ('["steer",{"steering_angle":0.1,"throttle":0.2}]', "steering_angle is 0.1, expected a"),
        ('["steer",{"steering_angle":"nan","throttle":"0"}]', "float.Parse does not take"),
        ('["steer",{"steering_angle":"0.1000"}]', "it has no throttle"),
        ('["steer","0.1000","0.2000"]', "it has 2 arguments, expected one object"),
        ('["steer",[0.1,0.2]]', "its argument is list, expected one object"),
        ('["steer"]', "its argument is NoneType, expected one object"),
        ('["manual",{},{}]', "it has 2 arguments, expected one object"),
        ('["steer",{"steering_angle":', "is no event with a name"),
    ],
)
def test_a_reply_that_the_original_swallows_ends_the_loop_and_is_explained(
    world: World, reply: str, words: str
) -> None:
    console = recorder()
    with RawDriver(lambda text: ["42" + reply] * text.startswith('42["telemetry"')) as driver:
        link = LegacySocket(driver.url)
        world.reset(0)
        client = Client(world, ClientOptions(), console)
        client.emit(link)
        end_s = time.monotonic() + 0.25
        while time.monotonic() < end_s:
            for event in link.events(0.02):
                client.take(link, *event)
        link.close()
    assert len(driver.telemetry) == 1
    assert world.frames == 0
    said = console.export_text()
    assert said.count("\n") == 1
    assert "swallowed, as by the original" in said
    assert words in said


@pytest.mark.parametrize(
    ("options", "reply"),
    [
        ({}, '42["steer",{"steering_angle":"0.0500","throttle":"0.2000"}]'),
        ({"manual": [[0, 9]]}, '42["manual",{}]'),
    ],
)
def test_a_silent_driver_is_told_of_with_the_reply_expected(monkeypatch, options, reply) -> None:
    monkeypatch.setattr(client_module, "SILENT_S", 0.3)

    def slow(text: str) -> Iterator[str]:
        if text.startswith('42["telemetry"'):
            time.sleep(0.7 if len(driver.telemetry) == 1 else 0)
            yield reply

    with RawDriver(slow) as driver:
        _, said = drive(driver, seconds=0.2, **options)
    assert said.count(f"expected: {reply}") == 1


def test_a_person_who_holds_w_sends_null_and_drives_straight_at_full_throttle() -> None:
    with RawDriver(steering_driver("0.5000", "0.0000")) as driver:
        client, said = drive(driver, manual=[[0, 0.3], [0.4, 0.5]], seconds=0.9)
    null = [text == '42["telemetry",null]' for text in driver.telemetry]
    # Both loops are on their way; each span's replies are null's, then pictures again.
    assert [held for i, held in enumerate(null) if i == 0 or held != null[i - 1]] == [
        True,
        False,
        True,
        False,
    ]
    assert client.counts["manual"] == sum(null)
    assert client.world.car.speed_mph > 2
    assert "2 times taken over by hand" in said


def test_the_car_is_the_persons_while_w_is_held(world: World) -> None:
    world.reset(0)
    client = Client(world, ClientOptions(manual=[[0.0, 0.4]]), recorder())
    client.command = (0.5, -1.0)
    client.advance()
    assert (world.car.steering, world.car.throttle) == (0.0, 1.0)
    while world.time < 0.4:
        client.advance()
    client.advance()
    assert (world.car.steering, world.car.throttle) == (0.5, -1.0)


def test_a_decimal_comma_goes_both_ways() -> None:
    with RawDriver(steering_driver("0,2000", "1,0000")) as driver:
        client, _ = drive(driver, decimal_comma=True)
    telemetry = json.loads(driver.telemetry[-1][2:])[1]
    assert telemetry["steering_angle"] == "5,0000"
    assert re.fullmatch(r"\d+,\d{4}", telemetry["speed"])
    assert client.command == (0.2, 1.0)


def test_a_point_under_a_decimal_comma_is_full_lock() -> None:
    with RawDriver(steering_driver("0.1000", "0,2000")) as driver:
        client, _ = drive(driver, decimal_comma=True)
    assert client.command == (1.0, 0.2)


def test_a_dropped_connection_is_made_again_at_once() -> None:
    with RawDriver(steering_driver()) as driver:
        client, said = drive(driver, drop_at=0.2)
    assert len(driver.requests) == 2  # one at a time: the first is closed, not leaked
    assert driver.times[1][0] - driver.times[0][-1] < RETRY_S / 2
    assert client.counts["connections"] == 2
    assert "dropped, as asked" in said


def test_a_driver_that_shuts_the_door_is_not_stormed() -> None:
    steer = steering_driver()

    def answer(text: str) -> list[str]:
        if len(driver.requests) < 3:
            raise EOFError
        return steer(text)

    with RawDriver(answer) as driver:
        drive(driver)
    assert len(driver.requests) == 3
    assert driver.times[2][0] - driver.times[0][0] > 1.9 * RETRY_S


@pytest.mark.parametrize("goes", [False, True])
def test_in_real_time_the_car_drives_on_without_replies(goes: bool) -> None:
    """After its first reply the driver answers nothing, or goes; in lock step the world stands."""
    replies = iter(["42" + json.dumps(["steer", STEER])])

    def answer(text: str) -> Iterator[str]:
        if "telemetry" in text:
            yield from replies
            if goes and len(driver.telemetry) == 2:
                driver.listener.close()
                raise EOFError

    with RawDriver(answer) as driver:
        client, said = drive(driver, clock="realtime", seconds=1.0)
    assert client.world.car.speed_mph > 8
    assert ("the connection is gone" in said) == goes


def test_in_real_time_each_reply_is_answered_at_the_next_frame() -> None:
    with RawDriver(steering_driver()) as driver:
        client, _ = drive(driver, clock="realtime", seconds=1.0)
    assert client.world.frames == 15
    # Two loops of 15 a second at most; Nagle's algorithm and a delayed ACK leave about 12 of each.
    assert 15 < client.counts["telemetry"] <= 2 * 15 + 2


def start_client(url: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "simulator", "client", f"url={url}", "quality=simple"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=Path(__file__).parents[2],
    )


def test_ctrl_c_ends_it_with_a_summary_and_refusals_are_met_calmly() -> None:
    with RefusingDriver() as driver, start_client(driver.url) as process:
        first = [process.stdout.readline() for _ in range(2)]
        time.sleep(1.2)
        process.send_signal(signal.SIGINT)
        rest = process.communicate(timeout=10)[0].splitlines()
    assert first[1].startswith(f"waiting for a driver at {driver.url}; start it with: python -m")
    assert "HTTP 400" in first[1]
    assert rest[0] == "stopped"
    assert rest[1].startswith("0.00 laps in 0.0 s")
    assert len(rest) == 2
    assert process.returncode == 0
    assert 2 <= len(driver.times) <= 4
    assert driver.left_open == 0


def test_a_closed_port_is_waited_for() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        url = f"http://127.0.0.1:{taken.getsockname()[1]}"
    with start_client(url) as process:
        lines = [process.stdout.readline() for _ in range(2)]
        process.terminate()
    assert lines[1] == (f"waiting for a driver at {url}; start it with: python -m zoo.drive CKPT\n")


def test_the_truth_is_told_when_asked() -> None:
    with RawDriver(steering_driver()) as driver:
        drive(driver, truth=True)
    message = json.loads(driver.telemetry[-2][2:])[1]
    assert float(message["time"]) > 0.2
    assert abs(float(message["cte"])) < 1
    assert message["lane"] == "3.2000"
    assert message["wall"] == message["put_back"] == "0.0000"


def put_back(options: ClientOptions, world: World, reply: dict) -> Client:
    """A client off the lake's road, which has taken a reply."""
    world.reset(0)
    world.put_back(Start(100, cte=5.0, speed_mph=9))
    client = Client(world, options, recorder())
    with RawDriver(steering_driver()) as driver, closing(LegacySocket(driver.url)) as link:
        client.frame()
        client.take(link, "steer", reply)
    return client


def test_a_reply_puts_the_car_back_on_the_road_when_asked(world: World) -> None:
    reply = {**STEER, "put_back": "12,0000"}
    options = ClientOptions(truth=True, put_back=True, decimal_comma=True)
    client = put_back(options, world, reply)
    assert (client.frame() == world.frame()).all(), "it is not the one from beside the road"
    assert world.cte == pytest.approx(0, abs=1e-3)
    assert world.place.distance == pytest.approx(100, abs=0.5)
    assert world.car.speed_mph == pytest.approx(12)
    assert client.counts["put back"] == 1


def test_a_name_that_rich_would_read_is_printed_as_it_stands(world: World) -> None:
    console = recorder()
    Client(world, ClientOptions(), console).say("[brightness] [/red] :car:")
    assert console.export_text() == "[brightness] [/red] :car:\n"


def test_a_reply_puts_nothing_back_as_the_original(world: World) -> None:
    put_back(ClientOptions(truth=True), world, {**STEER, "put_back": "12.0000"})
    assert abs(world.cte) > 4


def test_a_modern_driver_is_served_by_todays_library() -> None:
    with ModernDriver(STEER) as driver:
        client, said = drive(driver, protocol="modern", manual=[[0, 0.2]])
    assert driver.telemetry[0] == [None]  # one argument, null: as the original's
    assert set(driver.telemetry[-1][0]) == {"steering_angle", "throttle", "speed", "image"}
    assert client.counts["manual"] == 3
    assert client.counts["steer"] == 6
    assert client.world.car.speed_mph > 4
    assert "1 connections; 1 times taken over by hand" in said


def test_its_film_has_a_frame_for_each_of_the_worlds(tmp_path: Path) -> None:
    path = tmp_path / "lap.mp4"
    with RawDriver(steering_driver()) as driver:
        client, _ = drive(driver, film=str(path))
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == client.world.frames == 9
    assert video.get(cv2.CAP_PROP_FPS) == 15


def test_spans_of_seconds_may_be_whole_numbers_on_the_command_line() -> None:
    options = read_options(ClientOptions, ["manual=[[5,7],[20,21.5]]"])
    assert options.manual == [[5, 7], [20, 21.5]]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"protocol": "old"}, "protocol=old: must be legacy or modern"),
        ({"clock": "slow"}, "clock=slow"),
        ({"manual": [[3.0, 1.0]]}, "manual: must be pairs"),
        ({"manual": [5, 7]}, "manual: must be pairs"),
        ({"manual": [["a", "b"]]}, "manual: must be pairs"),
        ({"url": "nowhere"}, "url=nowhere: must be like http://127.0.0.1:4567"),
        ({"url": "nowhere", "protocol": "modern"}, "url=nowhere: must be like"),
        ({"film": "lap.avi"}, "must end in .mp4"),
        ({"track": "lak"}, "there is no track lak"),
    ],
)
def test_an_option_that_cannot_be_is_named(options: dict, words: str) -> None:
    with pytest.raises(SimulatorError, match=re.escape(words)):
        run_client(ClientOptions(**{"seconds": 0.1, **options}), Console(quiet=True))
