"""Measurement of the latency: the seconds from a steering command to the wheels."""

import math

import numpy as np

from zoo.checkpoints.policy_base import Policy

STEP_S, LONGEST_S = 0.02, 2.0  # resolution, and greatest latency that is recognized
FORGET_S = 10.0  # time constant after which an earlier comparison counts 1/e
JUDGE_EVERY_S = 0.1
FEWEST = 3  # comparisons before a latency is judged
LEAST_SIGNAL = (
    0.005**2
)  # mean squared error of the worst latency, below which the wheel stands still
EXPLAINED = 0.2  # greatest error of the best latency as a share of the worst latency's
ROUNDING = 1e-7  # mean squared error of telemetry with four decimals, and less than any signal


class LatencyMeter:
    """Meter that tells a policy that predicts ahead the latency and the commands on their way.

    Each steering that the simulator reports is compared with the commands that were sent 0, 0.02,
    ..., 2 s before. The latency is the shortest one with the smallest mean squared error, so that
    0 is a command that takes effect at once. It stays as it is while the steering is constant, or
    while no latency explains the reports.

    Args:
        policy: policy whose `latency_s` is set, first to 0, and whose method `expect` gets the
            commands.

    >>> policy, wheel = Policy(), [0.0, 0.0, 0.1, -0.2, 0.3, -0.1, 0.2]
    >>> meter = LatencyMeter(policy)
    >>> for frame, command in enumerate([0.1, -0.2, 0.3, -0.1, 0.2, 0.0, 0.0]):
    ...     meter.report(wheel[frame], 0.1 * frame)
    ...     meter.send(command)
    >>> policy.latency_s
    0.1
    """

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.policy.latency_s = 0.0
        count = round(LONGEST_S / STEP_S) + 1
        self._errors, self._weights = np.zeros(count), np.zeros(count)
        self._sent = np.zeros(count)  # command in force in each step before the last report
        self._judged_s = 0.0
        self.restart()

    def restart(self) -> None:
        """Forget the commands, after the car was put back or a person drove; keep the latency."""
        self._known = 0  # number of steps whose command is known
        self._command: float | None = None
        self._step = -1

    def send(self, steering: float) -> None:
        """Take the steering that is sent after a report, -1..1."""
        self._command = steering

    def report(self, steering: float, now_s: float) -> None:
        """Compare the steering of the wheels with earlier commands, and set the latency.

        Args:
            steering: steering that is in effect, -1..1.
            now_s: time of the drive in seconds.
        """
        step, count = round(now_s / STEP_S), len(self._sent)
        passed, self._step = min(step - self._step, count), step
        if self._command is None or passed <= 0:
            return
        self._sent[passed:] = self._sent[: count - passed].copy()
        self._sent[:passed] = self._command
        usable = self._known = min(self._known + passed, count)
        kept = math.exp(-passed * STEP_S / FORGET_S)
        self._errors *= kept
        self._weights *= kept
        self._errors[:usable] += (self._sent[:usable] - steering) ** 2
        self._weights[:usable] += 1
        if abs(now_s - self._judged_s) >= JUDGE_EVERY_S:
            self._judged_s = now_s
            self._judge()
        on_the_way = self._sent[: round((self.policy.latency_s or 0.0) / STEP_S)].copy()
        on_the_way[usable:] = steering  # nothing is known of the commands before: it stays
        self.policy.expect(on_the_way[::-1])

    def _judge(self) -> None:
        judged = int((self._weights >= FEWEST).sum())  # longer latencies have fewer comparisons
        if not judged:
            return
        errors = self._errors[:judged] / self._weights[:judged]
        best, worst = errors.min(), errors.max()
        if worst >= LEAST_SIGNAL and best <= EXPLAINED * worst:
            shortest = int(np.argmax(errors <= 1.1 * best + ROUNDING))
            self.policy.latency_s = round(shortest * STEP_S, 2)


def latency_meter(policy: Policy) -> LatencyMeter | None:
    """Return a meter for a policy that predicts steps ahead, None for any other."""
    return None if policy.latency_s is None else LatencyMeter(policy)
