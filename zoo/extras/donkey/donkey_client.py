"""A Donkeycar simulator as the simulator of a drive: here the driver is the client."""

import math
import time
from contextlib import closing

import eventlet
from eventlet.green import socket
from eventlet.greenthread import GreenThread

from zoo.base.errors import InputError
from zoo.base.rig import UDACITY
from zoo.driving.drive_record import FALLBACK
from zoo.driving.scenario import Scenario
from zoo.driving.world import State
from zoo.extras.donkey.donkey_world import DonkeyWorld
from zoo.server.driven_simulator import DrivenSimulator
from zoo.server.driver import GENTLE_BRAKE, Driver
from zoo.server.telemetry_message import PUT_BACK


class DonkeyClient(DrivenSimulator):
    """A green thread that drives in a Donkeycar simulator.

    Its telemetry becomes a message as the embedded simulator sends it, so that the driver judges,
    shows and records it in the same way.

    Args:
        driver: driver that answers the telemetry.
        address: see `DonkeyWorld`.
        laps: laps after which it ends; None drives until `stop`.
        put_back: whether an intervention puts the car back on the road.
    """

    def __init__(self, driver: Driver, address: str, laps: float | None, put_back: bool) -> None:
        self._driver, self._put_back = driver, put_back
        self._scenario = Scenario(address, laps=laps or math.inf, world="donkey")
        self._failure = ""
        self._task: GreenThread | None = None

    def start(self) -> None:
        """Connect, and drive."""
        self._task = eventlet.spawn(self._run)

    @property
    def ended(self) -> bool:
        """Whether the laps are driven, or the simulator failed."""
        return self._task is not None and self._task.dead

    def stop(self) -> str:
        """Leave the simulator; return what failed, empty if nothing did."""
        if self._task is not None:
            self._task.kill()
        return self._failure

    def _run(self) -> None:
        try:
            with closing(DonkeyWorld(self._scenario.track, socket)) as world:
                self._drive(world)
        except InputError as error:
            self._failure = str(error)
        finally:
            self._driver.disconnect(self._scenario.track)

    def _drive(self, world: DonkeyWorld) -> None:
        state = world.reset(self._scenario)
        self._driver.writer.rig = world.rig
        # A network that cannot drive an unknown car fails now, not at each frame.
        self._driver.policy.in_car(world.rig)(world.frame(), 0.0)
        session = self._driver.connect(self._scenario.track)
        while not state.done:
            came_s = time.perf_counter()
            reply = self._driver.answer(session, self._telemetry(world, state))
            self._driver.sent(reply, 1000 * (time.perf_counter() - came_s))
            if PUT_BACK in reply.values:
                state = world.put_back(float(reply.values[PUT_BACK]))
            else:
                # Here a brake reverses no car, also at speeds at which the driver does not brake.
                stop = self._driver.paused or reply.row.driver == FALLBACK
                state = world.step(reply.row.steering, GENTLE_BRAKE if stop else reply.row.throttle)
            eventlet.sleep(0)  # the page is served, however fast the simulator is

    def _telemetry(self, world: DonkeyWorld, state: State) -> dict[str, object]:
        return {
            "image": world.image,
            "time": state.time_s,
            "speed": state.speed_mph,
            "steering_angle": (state.steering or 0.0) * UDACITY.steering_deg,
            "cte": state.cross_track_m,
            "wall": float(bool(state.contact)),
            "put_back": float(self._put_back),
        }
