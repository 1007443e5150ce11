"""Drivers that are no networks: the baselines of the benchmark, and a person."""

import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from zoo.checkpoints.policy_base import Policy, as_policy
from zoo.driving.embedded_world import EmbeddedWorld
from zoo.driving.run_drives import PolicyMaker
from zoo.driving.scenario import Scenario
from zoo.driving.world import World
from zoo.simulator.expert import Expert

if TYPE_CHECKING:
    from zoo.simulator.hand_page import Seat

WAIT_S = 0.005  # between two looks at the hands
_OPEN = ExitStack()
LATE_S = 0.4  # delay of the late expert's commands, in seconds


@dataclass(frozen=True)
class Baseline(PolicyMaker):
    """What makes the policy of a baseline.

    Args:
        name: zero, mean, expert, expert_late, or human for a person who steers on a page.
        mean_steering: steering of the baseline `mean`, -1..1.
    """

    name: str
    mean_steering: float | None = None

    def policy(self, world: World, scenario: Scenario) -> Policy:
        """Return the policy of the baseline in the embedded world."""
        if self.name in ("zero", "mean"):
            steering = 0.0 if self.name == "zero" else float(self.mean_steering or 0.0)
            return as_policy(lambda frame, mph: (steering, None))
        simulated = cast(EmbeddedWorld, world).simulated  # other worlds have no such baseline
        if self.name == "human":
            return as_policy(by_hand(simulated.frame_s))
        expert = Expert(simulated.track)
        late = round(LATE_S / simulated.frame_s) if self.name == "expert_late" else 0
        waiting = deque([(0.0, 0.0)] * late)

        def drive(frame: Any, mph: float) -> tuple[float, float]:
            waiting.append(expert(simulated))
            return waiting.popleft()

        return as_policy(drive)


def by_hand(frame_s: float) -> Callable[[np.ndarray, float], tuple[float, None]]:
    """Return a person's steering of a drive: keys, mouse or gamepad, on a page.

    The person sees what a network sees, in real time. Each drive waits for the first key.

    Args:
        frame_s: seconds of a frame.
    """
    from zoo.simulator.hand_control import HandControl

    seat, control = _seat(), HandControl()
    due_s = 0.0

    def drive(frame: np.ndarray, mph: float) -> tuple[float, None]:
        nonlocal due_s
        notice = "" if due_s else "A key starts this road; Esc stops the benchmark"
        seat.show(frame, speed_mph=mph, steering=control.steering, notice=notice)
        while not due_s or time.perf_counter() < due_s or not seat.watched:
            if "escape" in seat.pressed():
                raise KeyboardInterrupt
            if not due_s and (seat.hands.held or seat.hands.stick):
                due_s = time.perf_counter() + frame_s
            time.sleep(WAIT_S)
        due_s = max(due_s, time.perf_counter() - frame_s) + frame_s
        return control.step(frame_s, seat.hands)[0], None

    return drive


@lru_cache(maxsize=1)
def _seat() -> "Seat":
    """Return one seat for all drives, whose page is served until the process ends."""
    from zoo.simulator.hand_page import served_seat

    return _OPEN.enter_context(served_seat(partial(print, flush=True), purpose=" and drive"))
