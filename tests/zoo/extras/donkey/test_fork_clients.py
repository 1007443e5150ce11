"""The dialects of the Udacity forks, against small replicas of their drivers."""

import base64
import io
import json
import math
from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest
from rich.console import Console

from tests.zoo.simulator.drivers import RawDriver, answering, event
from zoo.extras.donkey.fork_clients import MOST_UNANSWERED, ForkClient
from zoo.simulator.client import run_client
from zoo.simulator.command_options import ClientOptions

STRAIGHT = "@".join(f"10.0,1.9,{z:.1f}" for z in np.arange(5, 30, 1.3))
TIGHT = "0,1.9,0@0,1.9,20@4,1.9,26@10,1.9,24@11,1.9,0"  # a bend that the car cannot follow


def drive(dialect: str, reply: Callable, **options) -> tuple[list, ForkClient, str]:
    """Drive with a client; return the events that it sent, the client and its printed lines."""
    console = Console(record=True, width=400, file=io.StringIO())
    given = {"seconds": 1.0, "quality": "simple", "dialect": dialect, **options}
    with RawDriver(answering(reply)) as driver:
        client = run_client(ClientOptions(url=driver.url, **given), console)
    sent = [json.loads(text[2:]) for text in driver.messages[0] if text.startswith("42")]
    return sent, client, console.export_text()


def maxitwo(road: str, throttle: str = "1.0") -> Callable:
    """Return the replies of maxitwo's driver, which sends a road once, and resets at its end."""
    asked = False

    def reply(_: str, data: dict) -> Iterator[str]:
        nonlocal asked
        if data["hit"] != "none":
            yield event("reset", {})
        elif data["track"] == road:
            yield event("steer", {"steering_angle": "0.0", "throttle": throttle})
        elif not asked:
            asked = True
            yield event("track", {"track_string": road})

    return reply


def gym(*orders: str) -> Callable:
    """Return the replies of udacity-gym's driver: an action, and orders to the first telemetry."""
    orders_left = list(orders)

    def reply(name: str, _: dict) -> Iterator[str]:
        assert name == "car_telemetry"
        yield event("action", {"steering_angle": "0.0", "throttle": "1.0"})
        yield from orders_left
        orders_left.clear()

    return reply


def start(track: str, weather: str = "sunny") -> str:
    names = {"track_name": track, "weather_name": weather, "daytime_name": "day"}
    return event("start_episode", names)


def test_maxitwo_drives_the_road_of_its_string_and_begins_again_after_the_end() -> None:
    sent, client, printed = drive("maxitwo", maxitwo(STRAIGHT), seconds=7.0, frame_rate=5)
    telemetry = [data for _, data in sent if data["track"] == STRAIGHT]
    first = telemetry[0]
    assert (float(first["pos_x"]), float(first["pos_y"])) == pytest.approx((10, 1.9), abs=0.01)
    assert float(first["pos_z"]) == pytest.approx(5, abs=0.01)
    assert first["cte"] == first["cte_pid"] == "0.0000"
    ends = [number for number, data in enumerate(telemetry) if data["hit"] == "end_line_collider"]
    assert float(telemetry[ends[0]]["pos_z"]) == pytest.approx(31, abs=2)
    assert telemetry[ends[0] + 1]["hit"] == "none"
    assert float(telemetry[ends[0] + 1]["pos_z"]) == pytest.approx(5, abs=0.01)
    assert client.counts["episodes"] > 1
    assert f"{client.counts['episodes']} episodes in 7.0 s" in printed


def test_an_episode_of_the_laps_is_the_last() -> None:
    _, client, _ = drive("maxitwo", maxitwo(STRAIGHT), laps=1.0, seconds=20.0, frame_rate=5)
    assert client.world.at_end, "the end of an open road"


def test_maxitwo_speeds_are_in_metres_per_second() -> None:
    sent, _, _ = drive("maxitwo", maxitwo(STRAIGHT), frame_rate=25)
    before, after = (data for _, data in sent[-2:])
    moved_m = float(after["pos_z"]) - float(before["pos_z"])
    assert moved_m * 25 == pytest.approx(float(after["speed"]), rel=0.05)


def test_maxitwo_may_send_bends_that_the_car_cannot_follow() -> None:
    sent, _, printed = drive("maxitwo", maxitwo(TIGHT), seconds=0.4)
    assert sent[-1][1]["track"] == TIGHT
    assert "discarded" not in printed


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"track_string": "0,1.9,0@1,nan,40"}, "points"),
        ({"track_string": "0,1.9@5"}, "must be x,y,z@x,y,z@..."),
        ({"track_string": "0,1.9,0@1,2,wide"}, "must be x,y,z@x,y,z@..."),
        ({"track_string": 5}, "track_string: 5; must be a text"),
        (None, "track_string: None; must be a text"),
    ],
)
def test_a_bad_track_is_reported_and_the_road_is_kept(data, words) -> None:
    def reply(_: str, told: dict) -> Iterator[str]:
        assert told["track"] == "none"
        yield event("track", data)
        yield event("steer", {"steering_angle": "0.0", "throttle": "1.0"})

    _, client, printed = drive("maxitwo", reply, seconds=0.3)
    assert client.counts["discarded"] > 0
    assert "(track) was discarded" in printed
    assert words in printed


def test_udacity_gym_reads_numbers_and_an_image_and_episodes_are_answered() -> None:
    orders = event("end_episode"), start("mountain", "foggy")
    sent, client, _ = drive("udacity_gym", gym(*orders))
    data = [data for name, data in sent if name == "car_telemetry"][-1]
    frame = cv2.imdecode(np.frombuffer(base64.b64decode(data["image"]), np.uint8), 1)
    assert frame.shape == (160, 320, 3)
    for key in ("pos_x", "pos_y", "pos_z", "speed", "cte", "next_cte", "throttle"):
        assert isinstance(data[key], float)
    assert (data["lap"], data["sector"]) == (1, 0)
    assert data["semantic_segmentation"] == ""
    assert ["episode_metrics", {"collisionCount": 0, "outOfTrackCount": 0}] in sent
    names = [name for name, _ in sent if "telemetry" not in name]
    assert names == ["episode_metrics", "episode_events", "episode_ended", "episode_started"]
    assert client.world.track.name == "mountain"
    assert client.world.weather.fog == 0.4


def test_udacity_gym_sends_telemetry_while_a_person_drives() -> None:
    sent, client, _ = drive("udacity_gym", gym(), manual=((0.2, 0.4),))
    assert {name for name, _ in sent} == {"car_telemetry"}
    assert client.counts["taken over"] == 1


def test_a_paused_world_sends_telemetry_and_does_not_move() -> None:
    def reply(_: str, data: dict) -> Iterator[str]:
        nonlocal paused
        places.append(data["pos_x"])
        yield event("action", {"steering_angle": "0.0", "throttle": "1.0"})
        if len(places) in (5, 12):
            paused = not paused
            yield event("pause_sim" if paused else "resume_sim")

    places, paused = [], False
    sent, _, _ = drive("udacity_gym", reply, clock="realtime")
    assert [name for name, _ in sent if name.startswith("sim_")] == ["sim_paused", "sim_resumed"]
    assert len(set(places[7:12])) == 1
    assert places[-1] != places[11]


def test_udacity_gym_counts_a_car_off_the_track_and_puts_it_back() -> None:
    def reply(_: str, data: dict) -> Iterator[str]:
        errors.append(abs(data["cte"]))
        yield event("action", {"steering_angle": "1.0", "throttle": "1.0"})

    errors = []
    sent, client, _ = drive("udacity_gym", reply, seconds=7.0, frame_rate=5)
    happened = [data for name, data in sent if name == "episode_event"]
    assert happened[0]["key"] == "out_of_track"
    assert client.metrics["outOfTrackCount"] == len(happened)
    assert max(errors) <= 7.0


@pytest.mark.parametrize("track", ["roads/own.yaml", "/etc/passwd", "roads/own.yaml:1", "nowhere"])
def test_no_file_of_the_drivers_choice_is_opened(track) -> None:
    _, client, printed = drive("udacity_gym", gym(start(track)), seconds=0.3)
    assert client.counts["discarded"] == 1
    assert f"no track '{track}'" in printed


def test_a_slow_driver_gets_no_more_frames_than_it_can_answer() -> None:
    sent, _, _ = drive("maxitwo", lambda *_: iter(()), clock="realtime")
    assert len(sent) <= MOST_UNANSWERED + 1  # one more is sent when the session opens
    assert math.isfinite(float(sent[0][1]["cte"]))
