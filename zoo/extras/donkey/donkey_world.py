"""A Donkeycar simulator as a world: the Unity program, or `drivezoo simulator serve`.

The protocol is that of `gym-donkeycar` (github.com/tawnkramer/gym-donkeycar). A step sends a
control and waits for the next telemetry, so that a drive passes in the simulator's own time.
"""

import base64
import json
import math
import re
import socket
import time
from contextlib import suppress
from typing import Any

import numpy as np

from datamodules.image import decode_image
from zoo.base.errors import InputError
from zoo.base.limits import MOST_MPH, MOST_REPORTED, parse_number
from zoo.base.rig import MPS_PER_MPH
from zoo.base.rig_file import make_rig
from zoo.driving.open_world import world
from zoo.driving.scenario import SIMULATED, Scenario
from zoo.driving.world import State, World

SERVER = r"(?P<host>[\w.-]+|[\w.:%\[\]-]+(?=:\d{1,5}/))(?::(?P<port>\d{1,5}))?"  # IPv6 with a port
ADDRESS = re.compile(rf"(?:{SERVER}/)?(?P<scene>\w+(?::\d{{1,10}})?)")
HOST, PORT = "127.0.0.1", 9091
START = "start it, or: drivezoo simulator serve"
SILENT_S = 20.0  # for a simulator to answer; it loads a scene in seconds
LEAVING_S = 1.0  # for a simulator to take the last control
MOST_LINE = 16_000_000  # bytes of a message
MOST_DAMAGED = 20  # images in a row that cannot be read, 1 s of the Unity program
MOST_OLD = 100  # telemetry messages that are skipped for a newer one
LONGEST_LAP_S = 300.0
RATE = 20.0  # telemetry messages per second of the Unity program
MOST_STEERING = 90.0  # some simulators send degrees in place of a share
END_OF_ROAD = "end_of_road"  # `hit` of `drivezoo simulator serve` where an open road ends
BRAKE = {"steering": 0, "throttle": 0, "brake": 1}

Message = dict[str, Any]


@world("donkey")
def open_donkey(scenario: Scenario, renderer: str) -> World:
    """Return the world of a scenario, whose track is an address; its simulator renders."""
    return DonkeyWorld(scenario.track)


class DonkeyWorld(World):
    """A car in a Donkeycar simulator.

    The simulator gives no road width, and its cross-track error is that of its own middle line.
    After an intervention the car stands on the nearest node of the road.

    Args:
        address: `HOST:PORT/SCENE`, `HOST/SCENE` or `SCENE`.
        sockets: module `socket`, or its stand-in in a program of green threads.

    Attributes:
        image: latest image as the simulator sent it, in base64; damaged if `frame` is the last one.
        rig: car of `drivezoo simulator serve`; None for the Unity program, which does not say it.

    Raises:
        InputError: no simulator answers there, or it has no such scene.
    """

    frame_rate = RATE
    ignores = (*SIMULATED, "frame_rate")
    tied = "another program's world"

    def __init__(self, address: str, sockets: Any = socket) -> None:
        parts = ADDRESS.fullmatch(address)
        if parts is None:
            raise InputError(f"{address}: write HOST:PORT/SCENE, such as generated_track")
        self.address = address
        host, port = (parts["host"] or HOST).strip("[]"), int(parts["port"] or PORT)
        try:
            self._socket = sockets.create_connection((host, port), SILENT_S)
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or "no answer"
            raise InputError(f"{address}: no simulator at {host}:{port} ({why}); {START}") from None
        self._lines, self._crossings = self._socket.makefile("rb"), 0
        try:
            self._load(parts["scene"])
        except InputError:
            self.close()
            raise

    def reset(self, scenario: Scenario) -> State:
        """Put the car at the start of the scene."""
        self._laps = scenario.laps
        self._shape: tuple[int, ...] | None = None
        self._send("reset_car")
        self._send("get_protocol_version")
        answer = self._wait_for("protocol_version")
        self._crossings = self._damaged = 0  # messages before the answer are of the drive before
        with suppress(InputError):  # only `drivezoo simulator serve` sends its camera and its car
            self.rig = make_rig(answer.get("rig"), self.address)
        self._stand()
        self._began_s = self._required(self._telemetry, "time")
        return self._state()

    def frame(self, camera: str = "center") -> np.ndarray:
        """Return the camera's frame, uint8 [H, W, 3] RGB."""
        return self._frame

    def step(self, steering: float, throttle: float) -> State:
        """Send a control, and wait for the next telemetry; a throttle below 0 only brakes."""
        pedals = {"throttle": max(throttle, 0.0), "brake": max(-throttle, 0.0)}
        self._send("control", steering=steering, **pedals)
        self._take_telemetry()
        return self._state()

    def put_back(self, speed_mph: float) -> State:
        """Put the car on the nearest node of the road, at a standstill."""
        index = int(self._required(self._telemetry, "activeNode"))
        self._send("node_position", index=index)
        node = self._wait_for("node_position")
        keys = ("pos_x", "pos_y", "pos_z", "Qx", "Qy", "Qz", "Qw")
        self._send("set_position", **{key: self._required(node, key) for key in keys})
        self._stand()
        return self._state()

    def close(self) -> None:
        """Brake, and leave the simulator, where a car keeps its last control."""
        with suppress(InputError):
            self._send("control", **BRAKE)
        with suppress(OSError):
            # A connection that is closed with telemetry unread is reset, and the brake is lost.
            self._socket.shutdown(socket.SHUT_WR)
            self._socket.settimeout(LEAVING_S)
            until = time.monotonic() + LEAVING_S
            while time.monotonic() < until and self._socket.recv(65_536):
                pass
        self._lines.close()
        self._socket.close()

    def facts(self, scenario: Scenario) -> dict[str, Any]:
        """Return the source and the scene."""
        return super().facts(scenario) | {"source": "donkey", "track": scenario.track}

    def _load(self, scene: str) -> None:
        if self._wait_for("scene_selection_ready", "car_loaded")["msg_type"] == "car_loaded":
            self._send("exit_scene")
            self._wait_for("scene_selection_ready")
        self._send("get_scene_names")
        names = self._wait_for("scene_names").get("scene_names")
        scenes = [str(name) for name in names] if isinstance(names, list) else []
        if scene not in scenes:
            raise InputError(f"{self.address}: no such scene; it has {', '.join(scenes)}")
        self._send("load_scene", scene_name=scene)
        self._wait_for("car_loaded")

    def _send(self, kind: str, **values: object) -> None:
        # The Unity program takes texts only.
        message = {"msg_type": kind} | {key: str(value) for key, value in values.items()}
        try:
            self._socket.sendall(json.dumps(message).encode())
        except OSError as error:
            raise self._lost(error.strerror) from None

    def _wait_for(self, *kinds: str) -> Message:
        last_s = time.monotonic() + SILENT_S
        while time.monotonic() < last_s:
            try:
                line = self._lines.readline(MOST_LINE)
                if not line.endswith(b"\n"):
                    endless = f"it sent more than {MOST_LINE:,} bytes in a line"
                    raise self._lost(endless if len(line) == MOST_LINE else "it left")
                message = json.loads(line)
            except (OSError, ValueError, RecursionError) as error:
                raise self._lost(error) from None
            if not isinstance(message, dict):
                raise self._lost(f"it sent {line!r:.50}, which is no object")
            if message.get("msg_type") == "collision_with_starting_line":
                self._crossings += 1
            if message.get("msg_type") in kinds:
                return message
        raise self._lost(f"it sent no {' or '.join(kinds)} in {SILENT_S:.0f} s")

    def _has_more(self) -> bool:
        """Return whether a message has come, or begun to come."""
        self._socket.settimeout(0)
        try:
            return bool(self._lines.peek(1))
        except OSError as error:
            raise self._lost(error.strerror) from None
        finally:
            self._socket.settimeout(SILENT_S)

    def _stand(self) -> None:
        """Take the telemetry of a car that stands where it was put, from the next step on."""
        for _ in range(2):
            self._send("control", **BRAKE)
            self._take_telemetry()

    def _take_telemetry(self) -> None:
        self._telemetry = self._wait_for("telemetry")
        for _ in range(MOST_OLD):  # a slow network drives by the newest frame
            if not self._has_more():
                break
            self._telemetry = self._wait_for("telemetry")
        self.image = str(self._telemetry.get("image"))
        try:
            frame, self._damaged = decode_image(base64.b64decode(self.image)), 0
        except ValueError as error:
            self._damaged += 1
            if self._shape is None or self._damaged >= MOST_DAMAGED:
                raise self._lost(f"image: {error}") from None
            return
        if self._shape not in (None, frame.shape):
            raise self._lost(f"its frames changed from {self._shape} to {frame.shape}")
        self._frame, self._shape = frame, frame.shape

    def _state(self) -> State:
        time_s = self._required(self._telemetry, "time") - self._began_s
        speed_mps = self._optional("speed", MOST_MPH * MPS_PER_MPH)
        x, y = self._optional("pos_x"), self._optional("pos_z")
        hit = self._telemetry.get("hit") or "none"
        lap = max(self._crossings - 1, 0) + (hit == END_OF_ROAD)
        along = (self._optional("activeNode") or 0.0) / max(self._optional("totalNodes") or 1, 1)
        return State(
            time_s=time_s,
            speed_mph=math.nan if speed_mps is None else speed_mps / MPS_PER_MPH,
            steering=self._optional("steering_angle", MOST_STEERING),
            cross_track_m=self._optional("cte"),
            lap=lap,
            contact=hit not in ("none", END_OF_ROAD),
            xy=None if x is None or y is None else (x, y),
            share=min((lap + along) / self._laps, 1.0),
            done=lap >= self._laps or hit == END_OF_ROAD or time_s >= self._laps * LONGEST_LAP_S,
        )

    def _optional(self, key: str, most: float = MOST_REPORTED) -> float | None:
        """Return a number of the telemetry; None if the car's is unknown."""
        return parse_number(self._telemetry.get(key), most)

    def _required(self, message: Message, key: str) -> float:
        """Return a number without which no drive is possible."""
        value = parse_number(message.get(key))
        if value is None:
            raise self._lost(f"{key} is {message.get(key)!r:.40}, no number")
        return value

    def _lost(self, reason: object) -> InputError:
        return InputError(f"{self.address}: the simulator failed: {reason}; start it again")
