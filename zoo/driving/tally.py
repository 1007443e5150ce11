"""Running counts of a drive on a socket: interventions, latency, telemetry and autonomy."""

import math
from collections import Counter

import numpy as np

from zoo.base.terminal import counted
from zoo.driving.interventions import INTERVENTION_S, OFF_ROAD, STANDSTILL, TAKEOVER, WORDS

# Key in `drive.json` of the number of interventions of each kind.
KEYS = {OFF_ROAD: "off_road", STANDSTILL: "standstills", TAKEOVER: "takeovers"}
LONGEST_STEP_S = 1.0  # a longer step between two rows is a pause, which is not time driven

_BIN_MS = 0.05
_BINS = 20_000  # up to 1 s


def autonomy(interventions: int, driven_s: float) -> float:
    """Return NVIDIA's autonomy, 0..1; NaN if no time was driven.

    Bojarski et al. 2016 count 6 s for each intervention.

    >>> round(autonomy(10, 600.0), 3), autonomy(0, 30.0), autonomy(9, 30.0)
    (0.9, 1.0, 0.0)
    """
    if driven_s <= 0:
        return math.nan
    return max(0.0, 1 - INTERVENTION_S * interventions / driven_s)


class LatencyHistogram:
    """Histogram of latencies with bins of 0.05 ms, for percentiles in constant memory."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS + 1, np.int64)

    def add(self, latency_ms: float) -> None:
        """Count a latency."""
        self._counts[min(int(latency_ms / _BIN_MS), _BINS)] += 1

    def percentile(self, percent: float) -> float:
        """Return a percentile in ms, at most 1000; NaN without latencies.

        >>> histogram = LatencyHistogram()
        >>> for latency_ms in (1.0, 2.0, 3.0): histogram.add(latency_ms)
        >>> histogram.percentile(50)
        2.05
        """
        seen = self._counts.cumsum()
        wanted = max(1, math.ceil(percent / 100 * int(seen[-1])))
        bins = 1 + int(np.searchsorted(seen, wanted))
        return round(bins * _BIN_MS, 2) if seen[-1] else math.nan


class Tally:
    """Counts that grow during a drive; `figures` returns them for `drive.json`."""

    def __init__(self) -> None:
        self.telemetry = self.fallbacks = 0
        self.counts: Counter[str] = Counter()  # interventions by kind
        # `speed_s` is the integral of the speed over `known_s`, in which it is known.
        self.driven_s = self.served_s = self.known_s = self.speed_s = self.unjudged_s = 0.0
        self.latency = LatencyHistogram()

    @property
    def interventions(self) -> int:
        """Return the number of interventions of all kinds."""
        return self.counts.total()

    @property
    def autonomy(self) -> float:
        """Return NVIDIA's autonomy, 0..1; NaN if it cannot be measured.

        Without a cross-track error from the simulator, nobody knows whether the car is on the
        road. A takeover shows that a person watches the drive; then autonomy is measured from the
        takeovers. A car that did not move, or sent no speed, and needed no intervention, was not
        measured either.
        """
        if self.unjudged_s and not self.counts[TAKEOVER]:
            return math.nan
        if not self.speed_s and not self.interventions:
            return math.nan
        return autonomy(self.interventions, self.driven_s)

    def step(
        self, elapsed_s: float, served_s: float, speed_mph: float, judged: bool | None = True
    ) -> None:
        """Count one telemetry message of a client.

        Args:
            elapsed_s: seconds since the client's last telemetry, by the simulator's clock.
            served_s: seconds since the client's last telemetry, by the wall clock.
            speed_mph: speed of the car; NaN, for unknown, is left out of the mean.
            judged: whether the client sends its cross-track error; None before its first readable
                telemetry, until when nothing is driven.
        """
        self.telemetry += 1
        if served_s <= LONGEST_STEP_S:
            self.served_s += served_s
        if elapsed_s <= LONGEST_STEP_S and judged is not None:
            self.driven_s += elapsed_s
            self.unjudged_s += 0.0 if judged else elapsed_s
            if not math.isnan(speed_mph):
                self.known_s += elapsed_s
                self.speed_s += elapsed_s * speed_mph

    def figures(self) -> dict:
        """Return the figures that `drive.json` holds of a drive on a socket."""
        return {
            "driven_s": self.driven_s,
            "telemetry": self.telemetry,
            "telemetry_per_s": self.telemetry / self.served_s if self.served_s else math.nan,
            "latency_percentiles_ms": {f"p{p}": self.latency.percentile(p) for p in (50, 95, 99)},
            "mean_speed_mph": self.speed_s / self.known_s if self.known_s else math.nan,
            "interventions": self.interventions,
            **{key: self.counts[kind] for kind, key in KEYS.items()},
            "autonomy": self.autonomy,
            "fallbacks": self.fallbacks,
        }


def summary_lines(figures: dict) -> list[str]:
    """Return the lines that summarize a drive in the terminal."""
    if not figures["telemetry"]:
        return ["no simulator sent telemetry: nothing was driven"]
    rates = {"{:.0f} per second": "telemetry_per_s", "mean speed {:.1f} mph": "mean_speed_mph"}
    latency = figures["latency_percentiles_ms"]
    parts = [
        f"{figures['telemetry']:,} telemetry messages in {figures['driven_s']:.1f} s of driving",
        *(form.format(figures[key]) for form, key in rates.items() if math.isfinite(figures[key])),
    ]
    return [
        ", ".join(parts),
        f"latency {', '.join(f'{name} {value:.1f} ms' for name, value in latency.items())}",
        autonomy_line(figures),
    ]


def autonomy_line(figures: dict) -> str:
    """Return autonomy with the interventions by kind, or why it is not measured."""
    count = figures["interventions"]
    parts = [f"{figures[key]} {WORDS[kind]}" for kind, key in KEYS.items() if figures[key]]
    lost = counted(count, "intervention")
    lost += f" ({', '.join(parts)})" if parts else ""
    if math.isfinite(figures["autonomy"]):
        return f"autonomy {figures['autonomy']:.1%}: {lost}"
    reason = "this simulator sends no cross-track error, and nobody took over"
    if not figures["mean_speed_mph"] > 0:  # NaN after a single telemetry
        reason = "the car did not move, or sent no speed"
    return f"autonomy: not measured ({reason}){f'; {lost}' if count else ''}"
