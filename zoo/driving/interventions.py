"""The rule that decides when a car needs an intervention, in the embedded world and on a socket.

The driving score is one number per drive, by which a sweep ranks its trials.
"""

import math

INTERVENTION_S = 6.0  # duration of an intervention in NVIDIA's autonomy (Bojarski et al. 2016)
OFF_ROAD, STANDSTILL, TAKEOVER = "off_road", "standstill", "takeover"
WORDS = {OFF_ROAD: "off the road", STANDSTILL: "standing still", TAKEOVER: "taken over by hand"}
LEFT, RIGHT, WALL = "left", "right", "wall"  # sides of the road on which it was left, and a wall
INFRACTIONS = {
    LEFT: "left the road to the left",
    RIGHT: "left the road to the right",
    STANDSTILL: "stood still",
    WALL: "held by a wall, or turned away",
}
STALLED_BELOW_MPH, STALLED_S = 1.0, 5.0
LEAST_MARGIN_M = 0.2  # smallest margin of the options; a car is put back to 1 mm of the centre
HALF_M = 1.0  # the mean cross-track error that counts as half an intervention
DEFAULT_MARGIN_M = 3.2  # half the width of the lake's road, for a client that sends no lane width


class InterventionRule:
    """Rule that counts interventions: leaving the lane, or a speed below 1 mph for over 5 s.

    Bojarski et al. 2016 ("End to End Learning for Self-Driving Cars") put the car back on the
    centre after each intervention. A car that stays off the road costs another intervention every
    6 s, and a car that stays still another one every 5 s. Autonomy is thus never above the share
    of time on the road.

    Args:
        margin_m: distance from the centreline, in metres, above which the car has left the lane.

    Attributes:
        state: OFF_ROAD or STANDSTILL while the car is in that state, else None.

    >>> rule = InterventionRule(3.0)
    >>> [rule.judge(time_s, 9.0, 4.0) for time_s in (0.0, 1.0, 6.0)]
    ['off_road', None, 'off_road']
    >>> rule.infraction("off_road", 4.0), rule.infraction("off_road", -1.0)
    ('right', 'wall')
    """

    def __init__(self, margin_m: float) -> None:
        self.margin_m = margin_m
        self.restart()

    def restart(self) -> None:
        """Forget earlier moments, after the car was put back or a person drove it."""
        self.state: str | None = None
        self._moved_s: float | None = None
        self._off_s: float | None = None  # the last intervention of this stretch off the road
        self._stalled_s = -math.inf  # the last intervention of this standstill

    def judge(
        self, time_s: float, speed_mph: float, cross_track_m: float, at_wall: bool = False
    ) -> str | None:
        """Return the kind of intervention that begins now, None for none.

        Args:
            time_s: time of the drive in seconds; never decreases.
            speed_mph: speed of the car; NaN, for unknown, counts as moving.
            cross_track_m: distance from the centreline in metres; NaN, for unknown, counts as on
                the road.
            at_wall: whether a wall holds the car.
        """
        if self._moved_s is None or not speed_mph < STALLED_BELOW_MPH:
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

    def infraction(self, kind: str, cross_track_m: float) -> str:
        """Return what an intervention of a kind corrects, a key of `INFRACTIONS`."""
        if kind == STANDSTILL:
            return kind
        side = RIGHT if cross_track_m > 0 else LEFT
        return side if abs(cross_track_m) > self.margin_m else WALL


def driving_score(interventions: float, driven_s: float, cte_mean_m: float) -> float:
    """Return NVIDIA's autonomy less a small part for the cross-track error; at most 1.

    The score is 1 - 6 s * (interventions + e / (e + 1 m)) / driven_s, where e is the mean
    cross-track error in metres. The part e / (e + 1 m) stays below one intervention, so that over
    the same time a drive with fewer interventions always scores higher. Unlike autonomy, the score
    can fall below 0, so that a sweep can rank bad networks, too. It is NaN if no time was driven.

    >>> round(driving_score(0, 60.0, 0.25), 3), round(driving_score(0, 60.0, 1.0), 3)
    (0.98, 0.95)
    >>> driving_score(1, 60.0, 0.0) < driving_score(0, 60.0, 1000.0)
    True
    """
    if driven_s <= 0:
        return math.nan
    share = cte_mean_m / (cte_mean_m + HALF_M)
    return 1 - INTERVENTION_S * (interventions + share) / driven_s
