"""Clients of `dialect=`: the autonomous modes of two forks of the Udacity simulator.

Researchers of testing use them. `maxitwo` is the fork of github.com/testingautomated-usi/maxitwo,
`udacity_gym` that of github.com/DragonBanana/udacity-gym; the Unity side of both is
github.com/steflamb/self-driving-car-sim. Both send a frame when it is due, not for each reply;
positions are Unity's: x right, y up, z ahead; speeds are in m/s.
"""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

from zoo.base.errors import InputError
from zoo.base.rig import MPS_PER_MPH
from zoo.base.terminal import counted
from zoo.simulator.client import Client, Event, Telemetry
from zoo.simulator.simulated_world import Start
from zoo.simulator.telemetry import image_text
from zoo.simulator.track_content import make_track, road_content
from zoo.simulator.track_file import read_track
from zoo.simulator.track_names import is_included
from zoo.simulator.udacity_car import MAX_STEERING_DEG
from zoo.simulator.weather import read_weather

if TYPE_CHECKING:
    from zoo.simulator.client import Socket
    from zoo.simulator.track import Track

OUT_OF_TRACK_M = 7.0  # distance off the centreline, as in the fork
MOST_UNANSWERED = 3  # frames that are sent before a slow driver's replies; the next are skipped
FORGOTTEN_S = 2.0  # without a reply, after which none is expected
NEXT_S = 0.3  # seconds ahead of the car at which the fork measures `next_cte`
SECTOR_M = 20.0  # length of a sector; the fork's waypoints are not known here
NAMED = ("track", "weather", "daytime")
TRACKS = {"jungle": "udacity_jungle"}  # the fork's name of a track, where it differs
WEATHERS = {
    "sunny": "clear",
    "rainy": "{rain: 0.5, wet: 1, sun: 0.6}",
    "foggy": "{fog: 0.4, sun: 0.6}",
}


class ForkClient(Client, ABC):
    """A client that sends telemetry with each frame, and obeys further events.

    Attributes:
        answers: events that answer telemetry.
        orders: further events, see `obey`.
        paused: whether the world stands still while telemetry is sent.
        unanswered: number of frames that were sent and not answered.
    """

    answers: ClassVar[tuple[str, ...]]
    orders: ClassVar[tuple[str, ...]]
    paused = False
    unanswered = 0

    @property
    def finished(self) -> bool:
        """Return whether the options' seconds are driven over all episodes, or laps in one."""
        ends = len(self.cte) * self.world.frame_s >= (self.options.seconds or math.inf)
        return ends or (self.options.laps > 0 and self.world.is_complete(self.options.laps))

    @property
    def driven(self) -> str:
        """Return the number of episodes, in words."""
        return f"{counted(self.counts['episodes'], 'episode')}"

    @abstractmethod
    def obey(self, name: str, data: object) -> Iterator[Event]:
        """Obey an order; yield the events that are sent back.

        Raises:
            InputError: the order's data are wrong.
        """

    def handle_event(self, socket: "Socket", name: str, data: object) -> None:
        """Obey an order, or handle an event as the original client does."""
        self.unanswered = max(self.unanswered - (name in self.answers), 0)
        if name not in self.orders:
            super().handle_event(socket, "steer" if name == self.control else name, data)
            return
        self.replied_s = time.monotonic()
        try:
            for event in self.obey(name, data):
                socket.emit(*event)
        except InputError as error:
            self.counts["discarded"] += 1
            self.print_once(f"a message ({name}) was discarded: {error!s:.300}")

    def advance(self) -> None:
        """Advance by one frame, after which telemetry is due, unless the driver is behind."""
        if time.monotonic() - self.replied_s > FORGOTTEN_S:
            self.unanswered = 0
        self.due = int(self.unanswered < MOST_UNANSWERED)
        if not self.paused:
            super().advance()
            return
        self.next_frame_s = time.monotonic() + self.world.frame_s
        if self.options.clock == "lockstep":
            time.sleep(self.world.frame_s)  # the driver's replies never end

    def emit(self, socket: "Socket") -> None:
        """Send telemetry."""
        self.unanswered += 1
        super().emit(socket)

    def truth(self) -> dict[str, float]:
        """Return the numbers of both forks."""
        x, y, z, _, _ = self.world.pose()
        speed_mps = self.world.car.speed_mph * MPS_PER_MPH
        position = {"pos_x": x, "pos_y": z, "pos_z": y, "cte": self.world.cte}
        return {**super().truth(), **position, "speed": speed_mps}

    def begin(self, track: "Track | None" = None) -> None:
        """Begin an episode, at the road's begin, on another track or the same one."""
        options, old = self.options, self.world
        if track is None:
            old.reset(options.seed, Start(options.start), read_weather(options.weather))
        else:
            self.world = options.open(track=track)
            old.close()
        self.command, self._frame = (0.0, 0.0), None
        self.counts["episodes"] += 1


class MaxitwoClient(ForkClient):
    """A client whose roads the driver sends as `x,y,z@x,y,z@...`; `hit` reports their end."""

    answers = ("steer", "track", "reset")
    orders = ("track", "reset")
    track_string = "none"

    def telemetry(self) -> Telemetry:
        """Return the event of the car's state, the road and the frame."""
        name, data = super().telemetry()
        hit = "end_line_collider" if self.world.at_end else "none"
        return name, {**data, "hit": hit, "track": self.track_string}

    def truth(self) -> dict[str, float]:
        """Return the fork's numbers; its `cte_pid` is the cross-track error again."""
        return {**super().truth(), "cte_pid": self.world.cte}

    def obey(self, name: str, data: object) -> Iterator[Event]:
        """Begin again, on another road or the same one."""
        if name == "track":
            self.draw_road(data)
        else:
            self.begin()
        if self.options.clock == "lockstep":
            yield self.telemetry()  # in place of an answer, which the driver waits for

    def draw_road(self, data: object) -> None:
        """Begin on the road of a track string; bends may be tighter than the car can drive."""
        text = _field(data, "track_string")
        points = [point.split(",") for point in text.split("@")]
        try:
            content = road_content([(float(x), float(z), float(y)) for x, y, z in points])
        except ValueError:
            raise InputError(f"track_string={text!a:.50}: must be x,y,z@x,y,z@...") from None
        self.begin(make_track("track", content, tightest_m=0.0))
        self.track_string = text


class GymClient(ForkClient):
    """A client of episodes on named tracks, which puts the car back and counts why."""

    control = "action"
    answers = ("action",)
    orders = ("pause_sim", "resume_sim", "end_episode", "start_episode")
    track = ""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.metrics = {"collisionCount": 0, "outOfTrackCount": 0}
        self.happened: list[Event] = []

    def advance(self) -> None:
        """Advance by one frame; put a car back that hit a wall or left the track."""
        super().advance()
        world, kind = self.world, ""
        if abs(world.cte) > OUT_OF_TRACK_M:
            kind, count = "out_of_track", "outOfTrackCount"
        elif world.at_wall:
            kind, count = "collision", "collisionCount"
        if kind:
            self.metrics[count] += 1
            event = {"timestamp": self._timestamp, "key": kind, "value": ""}
            self.happened.append(("episode_event", event))
            world.put_back(Start(world.place.distance))
            self._frame = None

    def emit(self, socket: "Socket") -> None:
        """Send what happened, then telemetry."""
        for event in self.happened:
            socket.emit(*event)
        self.happened.clear()
        super().emit(socket)

    def telemetry(self) -> Telemetry:
        """Return the event of the car's state and the frame; there is no segmentation."""
        car = self.world.car
        numbers = {
            "steering_angle": car.steering * MAX_STEERING_DEG,
            "throttle": car.throttle,
            **self.truth(),
            "lap": self.world.lap + 1,
            "sector": int(self.world.place.distance / SECTOR_M),
        }
        texts = {"image": image_text(self.frame()), "semantic_segmentation": ""}
        return "car_telemetry", {"timestamp": self._timestamp, **texts, **numbers}

    def truth(self) -> dict[str, float]:
        """Return the fork's numbers, with the cross-track error a moment ahead."""
        world, numbers = self.world, super().truth()
        ahead_m = numbers["speed"] * NEXT_S
        x = world.car.x + ahead_m * math.cos(world.car.heading)
        y = world.car.y + ahead_m * math.sin(world.car.heading)
        next_cte = world.track.locate(x, y, world.place.distance).cte * world.direction
        return {**numbers, "next_cte": next_cte}

    def obey(self, name: str, data: object) -> Iterator[Event]:
        """Stop the world's time or let it pass, at an episode's end and begin, too."""
        if name == "start_episode":
            self.start_episode(data)
            yield "episode_started", None
        elif name == "resume_sim":
            self.paused = False
            yield "sim_resumed", None
        elif name == "pause_sim":
            self.paused = True
            yield "sim_paused", None
        else:
            self.paused = True
            yield "episode_metrics", dict(self.metrics)
            yield "episode_events", {}  # the fork's program sends none of them here
            yield "episode_ended", None

    def start_episode(self, data: object) -> None:
        """Begin an episode on a track, in a weather."""
        track, weather, day = (_field(data, f"{key}_name") for key in NAMED)
        name = TRACKS.get(track, track)
        if not is_included(name):  # a file of the driver's choice is not opened
            raise InputError(f"no track {track!a:.50}; see: drivezoo list tracks")
        if weather not in WEATHERS or day != "day":
            self.print_once("start_episode: there is sunny, rainy or foggy weather, by day")
        self.options = replace(self.options, weather=WEATHERS.get(weather, "clear"))
        self.begin(read_track(name) if name != self.track else None)
        self.track, self.paused = name, False
        self.metrics = dict.fromkeys(self.metrics, 0)

    @property
    def _timestamp(self) -> str:
        return f"{1000 * self.world.time:.0f}"  # the fork's is the wall clock's


def _field(data: object, key: str) -> str:
    text = data.get(key) if isinstance(data, dict) else None
    if not isinstance(text, str):
        raise InputError(f"{key}: {text!a:.50}; must be a text in one object")
    return text
