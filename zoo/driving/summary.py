"""What a drive comes to: NVIDIA's autonomy, latency, telemetry a second."""

import itertools
import math

INTERVENTION_S = 6.0  # what NVIDIA reckons that a person's intervention takes
LONGEST_STEP_S = 1.0  # a longer one is a pause between two drives, and counts for neither

_BIN_MS = 0.05
_BINS = 20_000  # up to a second


def autonomy(interventions: int, driven_s: float) -> float:
    """NVIDIA's share of the time that the car drove itself, 0..1; NaN where it never drove.

    >>> round(autonomy(10, 600.0), 3), autonomy(0, 30.0), autonomy(9, 30.0)
    (0.9, 1.0, 0.0)
    """
    if driven_s <= 0:
        return math.nan
    return max(0.0, 1 - INTERVENTION_S * interventions / driven_s)


class LatencyHistogram:
    """Percentiles of any number of latencies in the memory of 20,000 counts, to 0.05 ms."""

    def __init__(self) -> None:
        self._counts = [0] * (_BINS + 1)
        self.total = 0

    def add(self, latency_ms: float) -> None:
        self._counts[min(int(latency_ms / _BIN_MS), _BINS)] += 1
        self.total += 1

    def percentile(self, percent: float) -> float:
        """In ms; NaN where there is none, and 1000 for any above.

        >>> histogram = LatencyHistogram()
        >>> for latency_ms in (1.0, 2.0, 3.0): histogram.add(latency_ms)
        >>> histogram.percentile(50)
        2.05
        """
        if not self.total:
            return math.nan
        seen = itertools.accumulate(self._counts)
        wanted = max(1, math.ceil(percent / 100 * self.total))
        bins = 1 + next(index for index, one in enumerate(seen) if one >= wanted)
        return round(bins * _BIN_MS, 2)


class Tally:
    """Counts that grow while driving, from which the summary is made."""

    def __init__(self) -> None:
        self.telemetry = self.fallbacks = self.interventions = 0
        self.driven_s = self.served_s = self.speed_s = 0.0
        self.latency = LatencyHistogram()

    def step(self, elapsed_s: float, served_s: float, speed_mph: float) -> None:
        """A client's telemetry came `elapsed_s` after its last one by the simulator's clock, and
        `served_s` by the wall's."""
        self.telemetry += 1
        if served_s <= LONGEST_STEP_S:
            self.served_s += served_s
        if elapsed_s <= LONGEST_STEP_S:
            self.driven_s += elapsed_s
            self.speed_s += elapsed_s * speed_mph

    def figures(self) -> dict:
        """For `drive.json`, plain."""
        driven = self.driven_s
        return {
            "driven_s": driven,
            "telemetry": self.telemetry,
            "telemetry_per_s": self.telemetry / self.served_s if self.served_s else math.nan,
            "latency_ms": {f"p{p}": self.latency.percentile(p) for p in (50, 95, 99)},
            "mean_speed_mph": self.speed_s / driven if driven else math.nan,
            "interventions": self.interventions,
            "autonomy": autonomy(self.interventions, driven),
            "fallbacks": self.fallbacks,
        }


def summary_lines(figures: dict) -> list[str]:
    """The figures of a drive for a person to read."""
    if not figures["telemetry"]:
        return ["no simulator has driven"]
    latency = figures["latency_ms"]
    count = figures["interventions"]
    return [
        f"{figures['telemetry']:,} telemetry in {figures['driven_s']:.1f} s of driving, "
        f"{figures['telemetry_per_s']:.0f} a second served, "
        f"{figures['mean_speed_mph']:.1f} mph on average",
        f"latency p50 {latency['p50']:.1f} ms, p95 {latency['p95']:.1f} ms, "
        f"p99 {latency['p99']:.1f} ms",
        f"autonomy {figures['autonomy']:.1%}: {count} intervention{'' if count == 1 else 's'}",
    ]
