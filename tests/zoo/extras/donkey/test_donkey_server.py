"""The Donkeycar simulator's protocol: a session's answers, and clients over real sockets."""

import base64
import json
import math
import re
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.datamodules.exchange.test_tub import record, write_tub
from tests.refusals import refusal
from tests.zoo.extras.donkey.donkey_process import Process, donkey_simulator
from zoo.base.errors import InputError
from zoo.base.rig import RIGS
from zoo.base.rig_file import make_rig, rig_fields
from zoo.extras.donkey.donkey_server import MOST_BYTES, MessageStream, rig_line
from zoo.extras.donkey.donkey_session import NODE_M, SCENES, DonkeySession
from zoo.simulator.track_names import road_folder

# As gym-donkeycar sends it: each value is a text, and 0 keeps the default.
NO_CAMERA = {
    key: "0"
    for key in ("img_w", "img_h", "img_d", "img_enc", "fov", "fish_eye_x", "fish_eye_y")
    + tuple(f"{kind}_{axis}" for kind in ("offset", "rot") for axis in "xyz")
}


@pytest.fixture
def notes() -> list[str]:
    return []


@pytest.fixture
def session(notes: list[str]) -> Iterator[DonkeySession]:
    opened = DonkeySession("generated_road", 20.0, True, "software", notes.append)
    yield opened
    opened.close()


def control(steering: object = 0, throttle: object = 0, brake: object = 0) -> dict:
    values = {"steering": steering, "throttle": throttle, "brake": brake}
    return {"msg_type": "control"} | {key: str(value) for key, value in values.items()}


def say(session: DonkeySession, kind: str, **values: object) -> list[dict]:
    texts = {key: str(value) for key, value in values.items()}
    return list(session.answer({"msg_type": kind, **texts}))


def drive(session: DonkeySession, steps: int, **values: float) -> dict:
    """Send a control for each frame; return the last telemetry."""
    for _ in range(steps):
        *_, telemetry = session.answer(control(**values))
    return telemetry


def image_of(telemetry: dict, key: str = "image") -> np.ndarray:
    data = np.frombuffer(base64.b64decode(telemetry[key]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_UNCHANGED)


def test_a_client_chooses_a_scene(notes: list[str]) -> None:
    session = DonkeySession(None, 20.0, False, "software", notes.append)
    assert session.greeting["msg_type"] == "scene_selection_ready"
    (version,) = say(session, "get_protocol_version")
    assert (version["msg_type"], version["version"]) == ("protocol_version", "2")
    (scenes,) = say(session, "get_scene_names")
    assert {*SCENES, "lake", "udacity_lake", "lakeside"} <= {*scenes["scene_names"]}
    assert say(session, "load_scene", scene_name="mini_monaco") == [{"msg_type": "car_loaded"}]
    assert say(session, "exit_scene")[0]["msg_type"] == "scene_selection_ready"
    assert session.world is None
    with pytest.raises(InputError, match=r"load_scene.*'moon'.*get_scene_names"):
        say(session, "load_scene", scene_name="moon")


def test_a_client_names_roads_of_families_and_no_files(notes: list[str], tmp_path: Path) -> None:
    session = DonkeySession(None, 20.0, False, "none", notes.append)
    for scene in ("country:7", "alpine"):
        say(session, "load_scene", scene_name=scene)
        assert say(session, "regen_road", road_style="1", rand_seed="5") == []
    assert notes == []
    path = tmp_path / "own.yaml"
    shutil.copy(road_folder() / "alpine.yaml", path)
    assert "load_scene" in refusal(say, session, "load_scene", scene_name=f"{path}:1")
    session.close()


def test_telemetry_has_what_the_clients_read(session: DonkeySession) -> None:
    telemetry = drive(session, 30, steering=0.2, throttle=0.5)
    axes = {f"{name}_{axis}" for name in ("pos", "vel", "accel", "gyro") for axis in "xyz"}
    plain = {"steering_angle", "throttle", "speed", "time", "hit", "pitch", "yaw", "roll", "cte"}
    assert axes | plain | {"image", "activeNode", "totalNodes"} <= telemetry.keys()
    assert image_of(telemetry).shape == (120, 160, 3)
    assert telemetry["time"] == pytest.approx(1.5)
    assert telemetry["steering_angle"] == pytest.approx(0.2)
    assert telemetry["hit"] == "none"
    # A client's forward speed is the velocity along the heading that `yaw` gives.
    yaw = math.radians(telemetry["yaw"])
    ahead = telemetry["vel_x"] * math.sin(yaw) + telemetry["vel_z"] * math.cos(yaw)
    assert ahead == pytest.approx(telemetry["speed"], rel=0.02)
    assert telemetry["gyro_y"] > 0, "it turns right, clockwise seen from above"


def test_a_steering_of_1_turns_the_wheels_16_degrees(session: DonkeySession) -> None:
    drive(session, 1, steering=1)
    assert session.world.car.steering * 25 == pytest.approx(16)


def test_a_brake_stops_and_a_throttle_below_0_reverses(session: DonkeySession) -> None:
    drive(session, 20, throttle=1)
    stopped = drive(session, 60, brake=1)
    assert stopped["speed"] == 0
    before = stopped["pos_x"], stopped["pos_z"]
    assert drive(session, 20, brake=1)["pos_x"] == before[0]
    back = drive(session, 20, throttle=-1)
    yaw = math.radians(back["yaw"])
    moved = back["pos_x"] - before[0], back["pos_z"] - before[1]
    assert moved[0] * math.sin(yaw) + moved[1] * math.cos(yaw) < -0.1


def test_the_same_controls_give_the_same_frames(notes: list[str]) -> None:
    seen = []
    for _ in range(2):
        session = DonkeySession("lake", 20.0, True, "software", notes.append)
        say(session, "step_mode", step_mode="synchronous", time_step="0.1")
        say(session, "load_scene", scene_name="lake")
        seen.append([drive(session, 1, steering=0.1, throttle=0.4) for _ in range(5)])
        session.close()
    assert seen[0] == seen[1]
    assert [round(telemetry["time"], 6) for telemetry in seen[0]] == [0.1, 0.2, 0.3, 0.4, 0.5]


def test_a_client_chooses_when_the_world_waits(notes: list[str]) -> None:
    session = DonkeySession(None, 10.0, False, "none", notes.append)
    say(session, "step_mode", step_mode="synchronous", time_step="0.05")
    say(session, "load_scene", scene_name="lake")
    assert session.waits
    assert session.world.frame_s == pytest.approx(0.05)
    say(session, "step_mode", step_mode="asynchronous")
    assert not session.waits
    assert session.world.frame_s == pytest.approx(0.1)
    session.close()


def test_reset_puts_the_car_at_the_start(session: DonkeySession) -> None:
    first = drive(session, 1)
    drive(session, 40, steering=0.5, throttle=1)
    assert say(session, "reset_car") == []
    assert drive(session, 1) == first


def test_cameras_have_the_size_a_client_asks_for(session: DonkeySession, notes: list[str]) -> None:
    usual = image_of(drive(session, 1))
    camera = NO_CAMERA | {"img_w": "200", "img_h": "66", "img_enc": "PNG", "fov": "90"}
    assert say(session, "cam_config", **camera) == []
    assert image_of(drive(session, 1)).shape == (66, 200, 3)
    say(session, "cam_config_b", **(NO_CAMERA | {"offset_x": "-0.8", "offset_y": "1.2"}))
    both = drive(session, 1)
    assert image_of(both, "image_b").shape == (66, 200, 3)
    assert both["image_b"] == both["imageb"] != both["image"]
    grey = NO_CAMERA | {"img_w": "160", "img_h": "120", "img_d": "1"}
    say(session, "cam_config", **grey)
    assert image_of(drive(session, 1)).shape == usual.shape[:2]
    assert notes == []


def test_the_rig_is_that_of_the_clients_camera(session: DonkeySession) -> None:
    assert session.rig == RIGS["donkey_sim"]
    assert "data.rig=donkey_sim" in rig_line(session.rig, None)
    camera = {"img_w": "200", "img_h": "66", "fov": "90", "offset_y": "0.9", "rot_x": "20"}
    say(session, "cam_config", **(NO_CAMERA | camera))
    (version,) = say(session, "get_protocol_version")
    rig = make_rig(json.loads(json.dumps(version["rig"])), "sent")
    lens, drawn = rig.cameras["center"], session.cameras["center"]
    assert (lens.size, lens.vertical_fov_deg, lens.up_m) == ((200, 66), 90, 0.9)
    assert lens.pitch_down_deg == drawn.pitch_down_deg == 20
    assert lens.ahead_m + rig.rear_axle_m == pytest.approx(drawn.ahead_m + 1.6)
    assert "tub=FOLDER" in rig_line(session.rig, None)


def record_tub(folder: Path, client: "Client", rows: int) -> None:
    """Record as Donkeycar's own client does."""
    shutil.rmtree(folder / "images", ignore_errors=True)
    write_tub(folder, [record(row) for row in range(rows)])
    for row in range(rows):
        client.send("control", steering="0.1", throttle="0.5", brake="0.0")
        frame = image_of(client.wait_for("telemetry"))
        cv2.imwrite(str(folder / "images" / f"{row}_cam_image_array_.jpg"), frame)


def test_a_tub_of_any_client_gets_the_rig_of_its_camera(tmp_path: Path) -> None:
    with donkey_simulator("rate=max", f"tub={tmp_path / 'tub'}") as (port, process):
        client = Client(port)
        client.load("generated_track")
        for camera in ({}, {"img_w": "200", "img_h": "100", "fov": "80"}):
            if camera:
                client.send("cam_config", **(NO_CAMERA | camera))
            record_tub(tmp_path / "tub", client, 3)
            recording = read_recordings(str(tmp_path / "tub"))
            assert recording.frame_size() == recording.rig.cameras["center"].size[::-1]
            assert (recording.rig == RIGS["donkey_sim"]) == (not camera)
        client.send("quit_app")
        lines = [process.stdout.readline() for _ in range(2)]
        assert any("rig.yaml" in line for line in lines), lines


def test_a_rig_of_another_car_in_the_tubs_folder_stays(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(json.dumps(rig_fields(RIGS["udacity"])))
    before = path.read_bytes()
    assert "udacity, and stays" in rig_line(RIGS["donkey_sim"], str(tmp_path))
    assert path.read_bytes() == before


def test_a_tub_of_no_user_is_named() -> None:
    line = rig_line(RIGS["donkey_sim"], "~nobodyx/tub")
    assert re.search(r"tub=~nobodyx/tub: no rig\.yaml is written", line)


def test_what_is_not_there_is_named(session: DonkeySession, notes: list[str]) -> None:
    say(session, "cam_config", **(NO_CAMERA | {"fish_eye_x": "0.4", "img_enc": "TGA"}))
    say(session, "lidar_config", maxRange="50.0")
    say(session, "dance")
    kinds = "fish_eye|TGA|lidar|dance"
    assert [re.search(kinds, note)[0] for note in notes] == kinds.split("|")


def test_a_road_is_drawn_from_a_seed(session: DonkeySession, notes: list[str]) -> None:
    lengths = []
    for seed in (1, 2, 1):
        say(session, "regen_road", road_style="0", rand_seed=str(seed), turn_increment="0.0")
        lengths.append(session.world.track.length)
    assert lengths[0] == lengths[2] != lengths[1]
    say(session, "load_scene", scene_name="lake")
    say(session, "regen_road", road_style="0", rand_seed="1")
    assert "generated_road" in notes[-1]


@pytest.mark.parametrize(("style", "family"), [(0, "alpine"), (1, "country"), (2, "lakeside")])
def test_a_style_of_roads_is_a_family(style: int, family: str, session: DonkeySession) -> None:
    for seed, number in ((7, 7), (2**31, 2**31 - 1)):
        say(session, "regen_road", road_style=str(style), rand_seed=str(seed))
        assert session.scene == f"{family}:{number}"


def test_a_node_is_a_place_to_put_the_car(session: DonkeySession) -> None:
    drive(session, 60, throttle=1)
    put_on_node(session, 40)
    telemetry = drive(session, 1)
    (node,) = say(session, "node_position", index=40)
    for key in ("pos_x", "pos_y", "pos_z"):
        assert telemetry[key] == pytest.approx(node[key], abs=0.3), key
    assert telemetry["activeNode"] == 40
    assert telemetry["cte"] == pytest.approx(0, abs=0.05)
    assert session.world.place.distance == pytest.approx(40 * NODE_M, abs=0.1)
    assert abs(session.world.heading_error) < 0.01
    assert all(abs(telemetry[f"accel_{axis}"]) < 10 for axis in "xyz"), "put there, not driven"


def crossings(session: DonkeySession, steps: int, **values: float) -> int:
    kinds = [reply["msg_type"] for _ in range(steps) for reply in session.answer(control(**values))]
    return kinds.count("collision_with_starting_line")


def put_on_node(session: DonkeySession, index: int) -> None:
    (node,) = say(session, "node_position", index=index)
    say(session, "set_position", **{key: node[key] for key in node if key[0] in "pQ"})


def test_crossings_of_the_starting_line_count_laps(session: DonkeySession) -> None:
    assert crossings(session, 40, throttle=1) == 1
    put_on_node(session, 0)
    assert crossings(session, 40, throttle=1) == 0, "it had hardly left the line"
    put_on_node(session, drive(session, 1)["totalNodes"] - 13)
    assert crossings(session, 10, throttle=-1) == 0
    assert crossings(session, 120, throttle=1) == 1
    assert crossings(session, 200, throttle=-1) == 0, "a lap is not driven backward"


@pytest.mark.parametrize("text", ["nan", "inf", "fast", ""])
def test_a_number_that_is_none_is_named(session: DonkeySession, text: str) -> None:
    with pytest.raises(InputError, match=r"control: steering=.*must be a number"):
        list(session.answer(control(steering=text)))
    assert drive(session, 1, steering="0,5")["steering_angle"] == pytest.approx(0.5)


def test_objects_come_in_pieces_and_together() -> None:
    stream = MessageStream()
    sent = [control(), {"car_name": 'a } " \\ {', "more": {"in": "}"}}, control()]
    data = "".join(map(json.dumps, sent)).encode()
    for size in (1, 7, len(data)):
        pieces = [data[start : start + size] for start in range(0, len(data), size)]
        assert [message for piece in pieces for message in stream.split(piece)] == sent


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"GET /socket.io/?EIO=4 HTTP/1.1\r\n", "no Donkeycar client"),
        (b'{"msg_type": }', "not JSON"),
        (b'{"a": "' + b"x" * MOST_BYTES, "more than"),
        (b'{"a": ' * MOST_BYTES, "more than"),
        (b'{"a":' + b"[" * 30_000 + b"]" * 30_000 + b"}", "not JSON"),
    ],
)
def test_what_is_no_message_is_refused(data: bytes, reason: str) -> None:
    assert reason in refusal(list, MessageStream().split(data))


class Client:
    """A small Donkeycar client: messages without a separator out, lines in."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=60)
        self.lines = self.socket.makefile("r", encoding="utf-8", newline="\n")

    def send(self, kind: str, **values: object) -> None:
        self.socket.sendall(json.dumps({"msg_type": kind, **values}).encode())

    def wait_for(self, kind: str) -> dict:
        while line := self.lines.readline():
            if (message := json.loads(line))["msg_type"] == kind:
                return message
        raise ConnectionError("the server has closed the connection")

    def load(self, scene: str) -> None:
        self.wait_for("scene_selection_ready")
        self.send("get_scene_names")
        self.wait_for("scene_names")
        self.send("load_scene", scene_name=scene)
        self.wait_for("car_loaded")


@pytest.fixture
def server() -> Iterator[tuple[int, Process]]:
    with donkey_simulator("clients=2") as started:
        yield started


def test_cars_drive_in_worlds_of_their_own(server: tuple[int, Process]) -> None:
    port, process = server
    first, second = Client(port), Client(port)
    first.load("generated_track")
    second.load("mountain_track")
    refused = Client(port)
    assert refused.lines.readline() == ""
    first.send("control", steering="0.0", throttle="1.0", brake="0.0")
    while first.wait_for("telemetry")["speed"] < 2:
        pass
    assert second.wait_for("telemetry")["speed"] < 0.5
    # One leaves in the middle of a message, and the other drives on.
    first.socket.sendall(b'{"msg_type": "con')
    first.socket.close()
    first.lines.close()
    times = [second.wait_for("telemetry")["time"] for _ in range(20)]
    assert times == sorted(times)
    second.send("quit_app")
    with pytest.raises(ConnectionError):
        second.wait_for("never")
    lines = [process.stdout.readline() for _ in range(5)]
    assert any("refused, 2 drive already" in line for line in lines), lines


@pytest.mark.slow  # real time: beside other work it takes longer, and can fail
def test_floods_take_no_frame_from_anybody() -> None:
    with donkey_simulator("clients=3") as (port, _):
        cars = Client(port), Client(port)
        for car in cars:
            car.load("generated_track")
        cars[0].socket.sendall(2000 * json.dumps(control(0.1, 0.2)).encode())
        for _ in range(50):
            socket.create_connection(("127.0.0.1", port), timeout=60).close()
        for car in cars:
            times = [car.wait_for("telemetry")["time"] for _ in range(20)]
            assert np.diff(times) == pytest.approx(0.05, abs=0.011)
            car.socket.close()
            car.lines.close()
