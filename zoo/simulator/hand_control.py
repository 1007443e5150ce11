"""Steering and throttle from keys, mouse and gamepad, with the original simulator's rates.

A person's, or those of a simulated student: the expert's commands, late and imprecise.
"""

from collections import deque
from collections.abc import Set
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from zoo.simulator.car import clamp
from zoo.simulator.expert import Expert
from zoo.simulator.simulated_world import World
from zoo.simulator.udacity_car import PHYSICS_STEP_S

# As in the original: a key changes steering by 0.05 every 0.02 s; Unity's axes (throttle, and
# steering on its way back to 0) change by 3 per second.
STEERING_PER_S = 2.5
AXIS_PER_S = 3.0
CRUISE_THROTTLE = 0.4
MOUSE_FULL_LOCK = 2 / 3  # share of the window's width, from where the button was pressed
DEAD_ZONE = 0.1  # smaller values of a stick count as 0
TAKES_OVER = 0.05  # a pedal pressed beyond this ends cruising

LEFT, RIGHT = frozenset({"arrow_left", "a"}), frozenset({"arrow_right", "d"})
UP, DOWN = frozenset({"arrow_up", "w"}), frozenset({"arrow_down", "s"})
MOUSE_BUTTON = "mouse1"
Part = Annotated[float, Field(ge=-1, le=1)]
REACTION_S = {"keyboard": 0.15, "mouse": 0.2}  # reaction time before a finger or the hand moves
PEDAL_AT = 0.3  # the expert's throttle or brake beyond which the pedal key is down
PRESS_AT, PRESS_SPREAD = 0.15, 0.3  # wanted steering that causes a tap; its relative spread
TAP_PAYS_S = 0.25  # seconds of the wanted steering that one tap replaces
LONGEST_TAP_S = 0.6
HAND_S = 0.12  # time constant of the hand's movement with the mouse
WOBBLE, WOBBLE_S = 0.015, 0.5  # random steering of the hand: standard deviation, time constant
MOUSE_DEAD_BAND = 0.012  # smaller changes of the wanted steering do not move the hand
WINDOW_WIDTH = 1280  # pixels; the mouse moves by whole ones


@dataclass(frozen=True)
class Hands:
    """Input of a person at one moment.

    Args:
        held: Panda3D's names of the keys and mouse buttons that are down.
        pointer: x of the mouse, 0 at the window's left edge, 1 at its right.
        stick: position of a gamepad's stick or a steering wheel, -1..1, right positive.
        pedals: accelerator minus brake, -1..1.
    """

    held: Annotated[Set[str], Field(max_length=16)] = frozenset()
    pointer: Annotated[float, Field(ge=-10, le=10)] = 0.5
    stick: Part = 0.0
    pedals: Part = 0.0


class HandControl:
    """Steering and throttle over time; keys take precedence over mouse and gamepad."""

    def __init__(self) -> None:
        self.cruising = False
        self.release()

    def release(self) -> None:
        """Reset steering and throttle to 0, as after the car is put back."""
        self.steering = self.throttle = 0.0
        self._pressed_at: float | None = None

    def step(self, seconds: float, hands: Hands) -> tuple[float, float]:
        """Return steering and throttle after `seconds`, -1..1 each, right and forward positive."""
        self.steering = self._steer(seconds, hands)
        self.throttle = self._accelerate(seconds, hands)
        return self.steering, self.throttle

    def _steer(self, seconds: float, hands: Hands) -> float:
        way = bool(hands.held & RIGHT) - bool(hands.held & LEFT)
        if MOUSE_BUTTON not in hands.held:
            self._pressed_at = None
        elif self._pressed_at is None:
            self._pressed_at = hands.pointer
        if way:
            return clamp(self.steering + way * STEERING_PER_S * seconds)
        if self._pressed_at is not None:
            return clamp((hands.pointer - self._pressed_at) / MOUSE_FULL_LOCK)
        if abs(hands.stick) > DEAD_ZONE:
            beyond = (abs(hands.stick) - DEAD_ZONE) / (1 - DEAD_ZONE)
            return clamp(beyond if hands.stick > 0 else -beyond)
        return _towards(self.steering, 0.0, AXIS_PER_S * seconds)

    def _accelerate(self, seconds: float, hands: Hands) -> float:
        way = bool(hands.held & UP) - bool(hands.held & DOWN)
        # The original keeps cruising whatever is pressed; here braking ends it.
        if way < 0 or abs(hands.pedals) > TAKES_OVER:
            self.cruising = False
        if self.cruising:
            return CRUISE_THROTTLE
        if way:
            # From accelerating directly to braking, as Unity's axes with "snap".
            begin = self.throttle if self.throttle * way > 0 else 0.0
            return _towards(begin, float(way), AXIS_PER_S * seconds)
        if abs(hands.pedals) > TAKES_OVER:
            return clamp(hands.pedals)
        return _towards(self.throttle, 0.0, AXIS_PER_S * seconds)


def _towards(value: float, target: float, change: float) -> float:
    return min(value + change, target) if value < target else max(value - change, target)


class KeyTaps:
    """Taps of the steering keys, each as long as the wanted turn needs, with pauses between."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._key: str | None = None
        self._release_s = self._next_s = 0.0
        self._press_at = PRESS_AT

    def __call__(self, time: float, wish: float) -> Hands:
        """Return the key held `time` seconds into the drive, if any."""
        if self._key and time >= self._release_s:
            self._key = None
        if not self._key and time >= self._next_s and abs(wish) > self._press_at:
            self._press(time, wish)
        return Hands(frozenset({self._key} if self._key else ()))

    def _press(self, time: float, wish: float) -> None:
        self._key = "d" if wish > 0 else "a"
        # During a tap, steering rises to STEERING_PER_S times its length, then falls: a triangle.
        area = abs(wish) * TAP_PAYS_S
        peak = np.sqrt(2 * area / (1 / STEERING_PER_S + 1 / AXIS_PER_S))
        held_s = min(peak / STEERING_PER_S * self.rng.uniform(0.75, 1.25), LONGEST_TAP_S)
        self._release_s = time + held_s
        self._next_s = self._release_s + self.rng.uniform(0.08, 0.2)
        self._press_at = PRESS_AT * self.rng.uniform(1 - PRESS_SPREAD, 1 + PRESS_SPREAD)


class MouseHand:
    """A hand on the mouse with its button down: smooth, slightly wobbling, in whole pixels."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._hand = self._wobble = self._target = 0.0

    def __call__(self, time: float, wish: float) -> Hands:
        """Return button and pointer; call once for each physics step."""
        if abs(wish - self._target) > MOUSE_DEAD_BAND:
            self._target = wish
        step = PHYSICS_STEP_S
        self._hand += (self._target - self._hand) * step / HAND_S
        kick = WOBBLE * np.sqrt(2 * step / WOBBLE_S) * self.rng.standard_normal()
        self._wobble += kick - self._wobble * step / WOBBLE_S
        pointer = 0.5 + (self._hand + self._wobble) * MOUSE_FULL_LOCK
        # The first call presses the button in the middle of the window.
        return Hands(frozenset({MOUSE_BUTTON}), round(pointer * WINDOW_WIDTH) / WINDOW_WIDTH)


HANDS: dict[str, type[KeyTaps] | type[MouseHand]] = {"keyboard": KeyTaps, "mouse": MouseHand}


class HumanControl:
    """A driver that imitates a person: `human(world) -> (steering, throttle)`.

    It must be called once for each physics step.

    Args:
        control: keyboard or mouse.
        expert: driver whose commands the person imitates; its `reaction_s` allows for the delay.
        seed: random seed of the person's inaccuracy.
    """

    def __init__(self, control: str, expert: Expert, seed: int = 0) -> None:
        self.expert = expert
        self.hands = HANDS[control](np.random.default_rng([seed, len(control)]))
        self.control = HandControl()
        late = round(REACTION_S[control] / PHYSICS_STEP_S)
        self._wishes = deque([(0.0, 0.0)] * late, maxlen=late + 1)

    @property
    def recording(self) -> bool:
        """Return whether to record this moment: not while the expert leaves its line on purpose."""
        return self.expert.recording

    def __call__(self, world: World) -> tuple[float, float]:
        """Return steering (right positive) and throttle, -1..1, for one physics step."""
        self._wishes.append(self.expert(world))
        wish, push = self._wishes[0]
        hands = self.hands(world.time, wish)
        pedal = {"w"} if push > PEDAL_AT else {"s"} if push < -PEDAL_AT else set()
        return self.control.step(world.frame_s, Hands(hands.held | pedal, hands.pointer))
