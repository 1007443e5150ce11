"""A Donkeycar simulator's side of its protocol: one client's car in a world of its own.

The messages are those of `gym-donkeycar` (the client) and `sdsandbox` (the Unity program), both at
github.com/tawnkramer. One unit of the Unity program is a metre here, and nothing is divided by its
scale of 8. A cross-track error is right of the centreline where it is positive.
"""

import base64
import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from zoo.base.errors import InputError
from zoo.base.rig import MPS_PER_MPH, RIGS, UDACITY, Rig, centred, donkey_sim
from zoo.base.rig_file import rig_fields
from zoo.simulator.road_family import MOST_SEED
from zoo.simulator.simulated_world import Start, World, open_world
from zoo.simulator.track_names import DRAWN, family_names, recorded_name, track_names
from zoo.simulator.udacity_car import FOV_DEG, PIXELS

# What is driven for each scene of the Unity program: closed roads, so that laps are counted.
SCENES = {
    "generated_road": "lakeside:3",
    "warehouse": "country:3",
    "sparkfun_avc": "country:6",
    "generated_track": "lake",
    "mountain_track": "mountain",
    "roboracingleague_1": "udacity_lake",
    "waveshare": "lakeside:6",
    "mini_monaco": "country:11",
    "warren": "lakeside:11",
    "thunderhill": "udacity_jungle",
    "circuit_launch": "lakeside:16",
}
STYLES = "alpine", "country", "lakeside"  # families of `road_style` 0, 1 and 2
STEERING_DEG = RIGS["donkey_sim"].steering_deg  # of the wheels at a steering of 1
RATE = 20.0  # telemetry messages per second
NODE_M = 2.0  # between two nodes of a road
LINE_M = 1.0  # of the starting line; a drive begins before it
AGAIN_M = 20.0  # before the line, from where a car can cross it again; more than a frame's way
ENCODINGS = {"JPG": ".jpg", "PNG": ".png"}
CAMERA = donkey_sim().cameras["center"]

Message = dict[str, Any]


class DonkeySession:
    """The car of one client.

    Args:
        scene: scene to begin in; None lets the client choose one.
        rate: frames per second of the world's time.
        lockstep: whether a frame is due for each control only, in no real time.
        renderer: auto, software or opengl.
        note: function called with a line on what a client asks for in vain.

    Attributes:
        waits: whether the world waits for controls, by `lockstep` or the client's `step_mode`.
        ended: whether the client asked to end.
    """

    def __init__(
        self,
        scene: str | None,
        rate: float,
        lockstep: bool,
        renderer: str,
        note: Callable[[str], None],
    ) -> None:
        self.note, self.renderer, self.rate, self.lockstep = note, renderer, rate, lockstep
        self.world: World | None = None
        self.waits, self.ended, self._frame_s = lockstep, False, 1 / rate
        self.cameras, self.encoding, self.is_grey = {"center": CAMERA}, ".jpg", False
        self.control = (0.0, 0.0, 0.0)
        self._velocity, self._can_cross = np.zeros(3), True
        if scene is not None:
            self._open(scene)

    @property
    def greeting(self) -> Message:
        """Return the first message: of the menu, or of the scene that is loaded."""
        if self.world is None:
            return {"msg_type": "scene_selection_ready", "loaded": "1"}
        return {"msg_type": "car_loaded"}

    @property
    def rig(self) -> Rig:
        """Return the car that the client drives, with the camera that it set."""
        return centred(donkey_sim(self.cameras["center"]))

    def answer(self, message: Message) -> Iterator[Message]:
        """Obey a message of the client, and yield the answers.

        Raises:
            InputError: the message lacks a key, or a value is not allowed.
        """
        kind = message.get("msg_type")
        if kind == "control":
            self.control = (
                _number(message, "steering", -1, 1),
                _number(message, "throttle", -1, 1),
                _number(message, "brake", 0, 1, default=0),
            )
            if self.world is not None and self.waits:
                yield from self.advance(self.world)
        elif kind == "get_protocol_version":
            # The Unity program sends no rig, and its clients ignore it.
            yield {"msg_type": "protocol_version", "version": "2", "rig": rig_fields(self.rig)}
        elif kind == "get_scene_names":
            yield {"msg_type": "scene_names", "scene_names": scene_names()}
        elif kind == "load_scene":
            scene = str(message.get("scene_name"))
            drawn = DRAWN.fullmatch(scene)
            # A family's file of the client's choice is not opened.
            if scene not in scene_names() and (drawn is None or drawn[1] not in family_names()):
                raise InputError(f"load_scene: no scene {scene!a:.50}; ask get_scene_names")
            self._open(scene)
            yield self.greeting
        elif kind == "exit_scene":
            self.close()
            yield self.greeting
        elif kind == "quit_app":
            self.ended = True
        elif kind == "step_mode":
            self._set_step_mode(message)
        elif kind in ("car_config", "racer_info"):
            pass  # body and names are not drawn
        elif kind == "lidar_config":
            self.note("lidar_config: there is no lidar here")
        elif self.world is None:
            self.note(f"{str(kind)!a:.50}: not known before a scene is loaded")
        elif kind in ("cam_config", "cam_config_b"):
            self._set_camera("center" if kind == "cam_config" else "b", message)
        elif kind == "reset_car":
            self._begin(self.world)
        elif kind == "regen_road":
            self._draw_road(message)
        elif kind == "set_position":
            self._set_position(self.world, message)
        elif kind == "node_position":
            last = _nodes(self.world) - 1
            yield _node(self.world, int(_number(message, "index", 0, last)))
        else:
            self.note(f"{str(kind)!a:.50}: is no message of a Donkeycar client")

    def advance(self, world: World) -> Iterator[Message]:
        """Drive one frame, and yield a crossing of the starting line and the telemetry."""
        steering, throttle, brake = self.control
        # A brake only stops the car; a throttle below 0 reverses it.
        world.car.reverses = brake == 0
        world.step(steering * STEERING_DEG / UDACITY.steering_deg, throttle - brake)
        past_m, length = (world.place.distance - LINE_M) % world.track.length, world.track.length
        self._can_cross |= length / 2 < past_m < length - AGAIN_M
        if self._can_cross and past_m < AGAIN_M:
            self._can_cross = False
            yield {
                "msg_type": "collision_with_starting_line",
                "starting_line_index": 0,
                "timeStamp": world.time,
            }
        yield self.telemetry(world)

    def telemetry(self, world: World) -> Message:
        """Return the message of the car's state and frames."""
        car = world.car
        _, _, up, _, climb = world.pose()
        east, north = np.array([math.cos(car.heading), math.sin(car.heading)])
        ahead, left = car.ahead_mps, car.left_mps
        velocity = np.array([ahead * east - left * north, 0.0, ahead * north + left * east])
        velocity[1] = math.hypot(ahead, left) * math.sin(climb)
        accel = (velocity - self._velocity) / world.frame_s
        self._velocity = velocity
        frames = {name: self._encoded(world, name) for name in self.cameras}
        vectors = {
            "pos": (car.x, up, car.y),
            "vel": velocity.tolist(),
            "accel": accel.tolist(),
            "gyro": (0.0, -car.yaw_rate, 0.0),  # to the right in Unity
        }
        return {
            "msg_type": "telemetry",
            "steering_angle": car.steering * UDACITY.steering_deg / STEERING_DEG,
            "throttle": max(car.throttle, 0.0) if self.control[2] else car.throttle,
            "image": frames["center"],
            # Stored programs write `imageb`, the client reads `image_b`.
            **({"image_b": frames["b"], "imageb": frames["b"]} if "b" in frames else {}),
            "hit": "wall" if world.at_wall else "end_of_road" if world.at_end else "none",
            "time": world.time,
            "speed": car.speed_mph * MPS_PER_MPH,
            "pitch": -math.degrees(climb),
            "yaw": _yaw_deg(car.heading),
            "roll": 0.0,
            "cte": world.cte,
            "activeNode": min(int(world.place.distance / NODE_M), _nodes(world) - 1),
            "totalNodes": _nodes(world),
            **{
                f"{name}_{axis}": number
                for name, numbers in vectors.items()
                for axis, number in zip("xyz", numbers, strict=True)
            },
        }

    def close(self) -> None:
        """Leave the scene, and free the renderer."""
        if self.world is not None:
            self.world.close()
        self.world = None

    def _open(self, scene: str) -> None:
        rig = replace(UDACITY, name="donkeycar", cameras=self.cameras)
        opened = open_world(track_of(scene), self.renderer, frame_rate=1 / self._frame_s, rig=rig)
        self.close()
        self.world, self.scene = opened, scene
        self._begin(opened)

    def _begin(self, world: World) -> None:
        world.reset(0)
        self.control, self._velocity, self._can_cross = (0.0, 0.0, 0.0), np.zeros(3), True

    def _set_step_mode(self, message: Message) -> None:
        asks = message.get("step_mode") == "synchronous"
        self.waits = self.lockstep or asks
        self._frame_s = _number(message, "time_step", 0.02, 1) if asks else 1 / self.rate
        if self.world is not None:
            self._open(self.scene)

    def _set_camera(self, name: str, message: Message) -> None:
        """Open the world again with a camera of other size, place or direction; 0 keeps it."""

        def number(key: str, low: float, high: float) -> float:
            value = _number(message, key, min(low, 0), high, default=0)
            if 0 < value < low:
                raise InputError(f"{message['msg_type']}: {key}={value:g}: must be {low:g} or more")
            return value

        camera = self.cameras.get(name, self.cameras["center"])
        width, height = (int(number(key, *PIXELS)) for key in ("img_w", "img_h"))
        if number("fish_eye_x", -10, 10) or number("fish_eye_y", -10, 10):
            self.note("fish_eye: lenses here have no distortion")
        right, up, ahead = (number(f"offset_{axis}", -50, 50) for axis in "xyz")
        if right or up or ahead:
            camera = replace(camera, right_m=right, up_m=up, ahead_m=ahead)
        down, turn, roll = (number(f"rot_{axis}", -180, 180) for axis in "xyz")
        if down or turn or roll:
            camera = replace(camera, pitch_down_deg=down, yaw_right_deg=turn, roll_deg=roll)
        camera = replace(
            camera,
            size=(width or camera.size[0], height or camera.size[1]),
            vertical_fov_deg=number("fov", *FOV_DEG) or camera.vertical_fov_deg,
        )
        first = camera if name == "center" else self.cameras["center"]
        size, fov_deg = first.size, first.vertical_fov_deg
        if (camera.size, camera.vertical_fov_deg) != (size, fov_deg):
            self.note("cam_config_b: has the size and the field of view of the first camera")
        self.cameras = {
            key: replace(camera, size=size, vertical_fov_deg=fov_deg)
            for key, camera in (self.cameras | {name: camera}).items()
        }
        if name == "center":
            encoding = str(message.get("img_enc", "0"))
            if encoding not in ("0", *ENCODINGS):
                self.note(f"img_enc={encoding!a:.20}: JPG is sent; JPG and PNG are known")
            self.encoding = ENCODINGS.get(encoding, ".jpg")
            self.is_grey = number("img_d", 0, 4) == 1
        self._open(self.scene)

    def _draw_road(self, message: Message) -> None:
        """Drive another road of a family: the style chooses the family, the seed the road."""
        if not DRAWN.fullmatch(track_of(self.scene)):
            self.note(f"regen_road: {self.scene} is no drawn road; load generated_road")
            return
        style = int(_number(message, "road_style", 0, 1e6, default=0))
        seed = int(_number(message, "rand_seed", 0, MOST_SEED, default=0))
        self._open(f"{STYLES[style % len(STYLES)]}:{seed}")

    def _set_position(self, world: World, message: Message) -> None:
        x, y = (_number(message, key, -1e5, 1e5) for key in ("pos_x", "pos_z"))
        turn, whole = (_number(message, key, -1, 1, default=0) for key in ("Qy", "Qw"))
        heading = math.pi / 2 - 2 * math.atan2(turn, whole)
        nearest = world.track.locate(x, y)
        right = float(np.angle(np.exp(1j * (nearest.heading - heading))))
        world.put_back(Start(nearest.distance, nearest.cte, math.degrees(right)))
        self._velocity = np.zeros(3)

    def _encoded(self, world: World, camera: str) -> str:
        frame = world.frame(camera)
        code = cv2.COLOR_RGB2GRAY if self.is_grey else cv2.COLOR_RGB2BGR
        encoded = cv2.imencode(self.encoding, cv2.cvtColor(frame, code))[1]
        return base64.b64encode(encoded.tobytes()).decode()


def scene_names() -> list[str]:
    """Return the scenes that a client may load: those of the Unity program, tracks, families."""
    return [*SCENES, *map(recorded_name, track_names()), *family_names()]


def track_of(scene: str) -> str:
    """Return the name of the track that is driven for a scene."""
    return SCENES.get(scene, f"{scene}:3" if scene in family_names() else scene)


def _nodes(world: World) -> int:
    return max(1, int(world.track.length / NODE_M))


def _node(world: World, index: int) -> Message:
    east, north, up = world.track.at(index * NODE_M).tolist()
    half = math.radians(_yaw_deg(float(world.track.heading_at(index * NODE_M)))) / 2
    position = {"pos_x": east, "pos_y": up, "pos_z": north}
    turn = {"Qx": 0.0, "Qy": math.sin(half), "Qz": 0.0, "Qw": math.cos(half)}
    return {"msg_type": "node_position", "index": index, **position, **turn}


def _yaw_deg(heading: float) -> float:
    """Return Unity's yaw in degrees, 0..360, clockwise from north."""
    return math.degrees(math.pi / 2 - heading) % 360.0


def _number(
    message: Message, key: str, low: float, high: float, default: float | None = None
) -> float:
    """Return a number of a message, clamped; clients send texts, some with a decimal comma."""
    text = str(message.get(key, default)).replace(",", ".")
    value = math.nan
    with suppress(ValueError):
        value = float(text)
    if not math.isfinite(value):
        raise InputError(f"{message['msg_type']}: {key}={text!a:.50}: must be a number")
    return min(max(value, low), high)
