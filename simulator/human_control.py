"""A simulated student at keyboard or mouse: the expert's commands, late and imprecise."""

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

REACTION_S = {"keyboard": 0.15, "mouse": 0.2}  # reaction time before a finger or the hand moves
PEDAL_AT = 0.3  # the expert's throttle or brake beyond which the pedal key is down
PRESS_AT, PRESS_SPREAD = 0.15, 0.3  # wanted steering that causes a tap; its relative spread
TAP_PAYS_S = 0.25  # seconds of the wanted steering that one tap replaces
LONGEST_TAP_S = 0.6
HAND_S = 0.12  # time constant of the hand's movement with the mouse
WOBBLE, WOBBLE_S = 0.015, 0.5  # random steering of the hand: standard deviation, time constant
MOUSE_DEAD_BAND = 0.012  # smaller changes of the wanted steering do not move the hand
WINDOW_WIDTH = 1280  # pixels; the mouse moves by whole ones


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


HANDS: dict[str, Callable[[np.random.Generator], KeyTaps | MouseHand]] = {
    "keyboard": KeyTaps,
    "mouse": MouseHand,
}


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
