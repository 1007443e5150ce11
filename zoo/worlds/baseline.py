"""Drivers that look at no frames: the baselines of the benchmark."""

from collections import deque
from dataclasses import dataclass
from typing import Any

from simulator.expert import Expert
from zoo.checkpoints.command import Policy, as_policy
from zoo.worlds.run_drives import PolicyMaker
from zoo.worlds.scenario import Scenario
from zoo.worlds.world import World

LATE_S = 0.4  # delay of the late expert's commands, in seconds


@dataclass(frozen=True)
class Baseline(PolicyMaker):
    """What makes the policy of a baseline.

    Args:
        name: zero, mean, expert or expert_late.
        mean_steering: steering of the baseline `mean`, -1..1.
    """

    name: str
    mean_steering: float | None = None

    def policy(self, world: World, scenario: Scenario) -> Policy:
        """Return the policy of the baseline in the embedded world."""
        if self.name in ("zero", "mean"):
            steering = 0.0 if self.name == "zero" else float(self.mean_steering or 0.0)
            return as_policy(lambda frame, mph: (steering, None))
        simulated = world.simulated
        expert = Expert(simulated.track)
        late = round(LATE_S / simulated.frame_s) if self.name == "expert_late" else 0
        waiting = deque([(0.0, 0.0)] * late)

        def drive(frame: Any, mph: float) -> tuple[float, float]:
            waiting.append(expert(simulated))
            return waiting.popleft()

        return as_policy(drive)
