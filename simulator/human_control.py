"""A student at the keyboard or the mouse: the expert's wish, seen late and steered by hand."""

from collections import deque
from collections.abc import Callable

import numpy as np

from simulator.expert import Expert
from simulator.hand_control import (
    AXIS_PER_S,
    MOUSE_BUTTON,
    MOUSE_FULL_LOCK,
    STEERING_PER_S,
    HandControl,
    Hands,
)
from simulator.rig import PHYSICS_STEP_S
from simulator.world import World

REACTION_S = {"keyboard": 0.15, "mouse": 0.2}  # from seeing to moving a finger, or the hand
PEDAL_AT = 0.3  # a person holds a pedal key down where the expert wants more than this
PRESS_AT, PRESS_SPREAD = 0.15, 0.3  # wanted steering at which a key is tapped; its relative spread
TAP_PAYS_S = 0.25  # one tap turns the car as much as the wanted steering does in this time
LONGEST_TAP_S = 0.6
HAND_S = 0.12  # time constant of the hand that follows the wish with the mouse
WOBBLE, WOBBLE_S = 0.015, 0.5  # steering that the hand adds: standard deviation, time constant
MOUSE_DEAD_BAND = 0.012  # a smaller difference leaves the hand where it is
WINDOW_WIDTH = 1280  # pixels: the mouse's steps


class KeyTaps:
    """Taps of the arrow keys, long enough to turn the car as much as wanted, then a pause."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._key: str | None = None
        self._release_s = self._next_s = 0.0
        self._press_at = PRESS_AT

    def __call__(self, time: float, wish: float) -> Hands:
        """Return the key that is down, if any, `time` seconds into the drive."""
        if self._key and time >= self._release_s:
            self._key = None
        if not self._key and time >= self._next_s and abs(wish) > self._press_at:
            self._press(time, wish)
        return Hands(frozenset({self._key} if self._key else ()))

    def _press(self, time: float, wish: float) -> None:
        self._key = "d" if wish > 0 else "a"
        # A tap's steering rises to STEERING_PER_S times its length and falls back: a triangle.
        area = abs(wish) * TAP_PAYS_S
        peak = np.sqrt(2 * area / (1 / STEERING_PER_S + 1 / AXIS_PER_S))
        held_s = min(peak / STEERING_PER_S * self.rng.uniform(0.75, 1.25), LONGEST_TAP_S)
        self._release_s = time + held_s
        self._next_s = self._release_s + self.rng.uniform(0.08, 0.2)
        self._press_at = PRESS_AT * self.rng.uniform(1 - PRESS_SPREAD, 1 + PRESS_SPREAD)


class MouseHand:
    """A hand on the mouse, button down: follows smoothly, wobbles, and moves by whole pixels."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._hand = self._wobble = self._target = 0.0

    def __call__(self, time: float, wish: float) -> Hands:
        """Return the button and the pointer, one physics step after the last call."""
        if abs(wish - self._target) > MOUSE_DEAD_BAND:
            self._target = wish
        step = PHYSICS_STEP_S
        self._hand += (self._target - self._hand) * step / HAND_S
        kick = WOBBLE * np.sqrt(2 * step / WOBBLE_S) * self.rng.standard_normal()
        self._wobble += kick - self._wobble * step / WOBBLE_S
        pointer = 0.5 + (self._hand + self._wobble) * MOUSE_FULL_LOCK
        # Pressed in the window's middle on the first call.
        return Hands(frozenset({MOUSE_BUTTON}), round(pointer * WINDOW_WIDTH) / WINDOW_WIDTH)


HANDS: dict[str, Callable[[np.random.Generator], KeyTaps | MouseHand]] = {
    "keyboard": KeyTaps,
    "mouse": MouseHand,
}


class HumanControl:
    """Drives a world as a person does: `human(world) -> (steering, throttle)`, each physics step.

    Args:
        control: keyboard or mouse.
        expert: what the person wants to do; it expects steering to come late by the reaction time.
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
        """Whether this moment belongs in a recording: not while the expert goes astray."""
        return self.expert.recording

    def __call__(self, world: World) -> tuple[float, float]:
        """Return steering (right positive) and throttle, -1..1, for one physics step."""
        self._wishes.append(self.expert(world))
        wish, push = self._wishes[0]
        hands = self.hands(world.time, wish)
        pedal = {"w"} if push > PEDAL_AT else {"s"} if push < -PEDAL_AT else set()
        return self.control.step(world.frame_s, Hands(hands.held | pedal, hands.pointer))
