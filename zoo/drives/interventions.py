"""The rule that decides when a car needs an intervention, in a scored drive and on the socket."""

import math

INTERVENTION_S = 6.0  # what NVIDIA reckons that a person's intervention takes
OFF_ROAD, STANDSTILL, TAKEOVER = "off_road", "standstill", "takeover"
WORDS = {OFF_ROAD: "off the road", STANDSTILL: "standing still", TAKEOVER: "taken over by hand"}
STALLED_BELOW_MPH, STALLED_S = 1.0, 5.0
LEAST_MARGIN_M = 0.2  # the car is put back on the centre to a millimetre
DEFAULT_MARGIN_M = 3.2  # half the width of the lake's road, for a client that sends no lane width


class InterventionRule:
    """Counts leaving the lane, or below 1 mph for 5 s, as an intervention.

    Bojarski et al. 2016 ("End to End Learning for Self-Driving Cars") put the car back after each
    one. A car that nobody puts back costs another intervention for every further 6 s off the road
    or 5 s of standing still: autonomy is then never above the share of time on the road.

    Args:
        margin_m: distance from the centreline that counts as leaving the lane.

    Attributes:
        state: OFF_ROAD or STANDSTILL while the car is, else None.

    >>> rule = InterventionRule(3.0)
    >>> [rule.judge(time_s, 9.0, 4.0) for time_s in (0.0, 1.0, 6.0)]
    ['off_road', None, 'off_road']
    """

    def __init__(self, margin_m: float) -> None:
        self.margin_m = margin_m
        self.restart()

    def restart(self) -> None:
        """Forget the past: the car is put back, or another driver has driven it."""
        self.state: str | None = None
        self._moved_s: float | None = None
        self._off_s: float | None = None  # the last intervention of this stretch off the road
        self._stalled_s = -math.inf  # the last intervention of this standstill

    def judge(
        self, time_s: float, speed_mph: float, cross_track_m: float, at_wall: bool = False
    ) -> str | None:
        """Return the kind of intervention that this moment costs, None for none.

        Args:
            time_s: of the drive; never decreases.
            speed_mph: of the car.
            cross_track_m: from the centreline; NaN where it is not known, which is on the road.
            at_wall: a wall holds the car.
        """
        if self._moved_s is None or speed_mph >= STALLED_BELOW_MPH:
            self._moved_s = time_s
        stalled = time_s - self._moved_s > STALLED_S
        if at_wall or abs(cross_track_m) > self.margin_m:
            self.state = OFF_ROAD
            if self._off_s is not None and time_s - self._off_s < INTERVENTION_S:
                return None
            self._off_s = self._stalled_s = time_s
            return OFF_ROAD
        self._off_s = None
        self.state = STANDSTILL if stalled else None
        if not stalled or time_s - self._stalled_s <= STALLED_S:
            return None
        self._stalled_s = time_s
        return STANDSTILL
