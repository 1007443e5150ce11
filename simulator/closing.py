"""The last segments of a closed road: Dubins' shortest way from its end to its start.

Source: L. E. Dubins 1957, "On curves of minimal length with a constraint on average curvature".
"""

import cmath
import math

LEAST_TURN = math.radians(2.0)  # a smaller arc is left out


def closing_segments(segments: list[dict], radius: float) -> list[dict]:
    """Return an arc, a straight and an arc that lead from the end of a road back to its start.

    Args:
        segments: segments of a track's file; the first one begins at the origin, to the east.
        radius: radius of both arcs in metres.

    Returns:
        The shortest such way, without arcs and straights that are too short; empty if none exists.
    """
    place, heading = end_of(segments)
    best: list[tuple[str, float]] = []
    for first in (1, -1):
        for last in (1, -1):
            way = _arc_straight_arc(place, heading, radius, first, last)
            if way and (not best or _total(way, radius) < _total(best, radius)):
                best = way
    found = []
    for kind, size in best:
        if kind == "straight" and size >= 1:
            found.append({kind: size})
        elif kind != "straight" and size >= LEAST_TURN:
            found.append({kind: math.degrees(size), "radius": radius})
    return found


def end_of(segments: list[dict]) -> tuple[complex, float]:
    """Return the end of segments as a complex number of metres, and the heading in radians."""
    place, heading = 0j, 0.0
    for one in segments:
        if "straight" in one:
            place += one["straight"] * cmath.exp(1j * heading)
            continue
        way = 1 if "left" in one else -1
        turn = way * math.radians(one.get("left", one.get("right")))
        centre = place + way * one["radius"] * 1j * cmath.exp(1j * heading)
        place = centre + (place - centre) * cmath.exp(1j * turn)
        heading += turn
    return place, heading


def _arc_straight_arc(
    place: complex, heading: float, radius: float, first: int, last: int
) -> list[tuple[str, float]]:
    """Return arc, straight and arc from a pose to the origin's, to the east; empty if impossible.

    Args:
        place: start of the way in metres.
        heading: heading there in radians.
        radius: radius of the arcs in metres.
        first: 1 if the first arc turns left, -1 if right.
        last: the same of the last arc.
    """
    begin = place + first * radius * 1j * cmath.exp(1j * heading)
    end = last * radius * 1j
    apart = abs(end - begin)
    across = radius * (first - last)  # offset of the straight between the circles' centres
    if apart <= abs(across) or apart == 0:
        return []
    straight = math.sqrt(apart**2 - across**2)
    direction = cmath.phase(end - begin) + math.atan2(across, straight)
    turn_first = (first * (direction - heading)) % (2 * math.pi)
    turn_last = (-last * direction) % (2 * math.pi)
    words = {1: "left", -1: "right"}
    return [(words[first], turn_first), ("straight", straight), (words[last], turn_last)]


def _total(way: list[tuple[str, float]], radius: float) -> float:
    return sum(size if kind == "straight" else size * radius for kind, size in way)
