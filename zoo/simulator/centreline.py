"""The geometry of a road's centreline, from control points, segments or a survey.

A closed road's last segments are Dubins' shortest way from its end to its start: L. E. Dubins 1957,
"On curves of minimal length with a constraint on average curvature".
"""

import cmath
import math
from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np

STEP_M = 0.5  # distance between samples of the centreline
SEGMENT_STEP_M = 1.0  # distance between the control points of a road of segments
TRANSITION_M = 6.0  # length over which the curvature changes between two segments (a clothoid)
SLOPE_M = 12.0  # length over which the grade changes between two segments
# A survey's points lie on the road, so a curve through them swings out between them. This weight
# of the third differences moves the points of the included surveys by up to 0.15 m: the curve then
# keeps 0.4 m from the survey's pieces, and the jungle's tightest bend has 6.8 m instead of 6.3 m.
SMOOTHING = 0.05
CLEARANCE_M = 5.0  # smallest height of a bridge above the road below it
VERGE_M = 2.5  # smallest distance between the edges of two parts of the road
MOST_PAIRS = 2_000_000  # pairs of samples in the same square, a limit on memory
BRIDGE_END_M = 6.0  # length of a bridge beyond the road below it, at each end
LEAST_TURN = math.radians(2.0)  # a smaller arc of a way back to the start is left out

# Straights and arcs: metres, radians turned (left positive) and metres climbed.
Segments = Sequence[tuple[float, float, float]]


def make_centreline(
    points: np.ndarray, closed: bool = True, fine: int = 200
) -> dict[str, np.ndarray | float]:
    """Return `Track`'s arrays of a smooth curve through control points.

    Args:
        points: float64 [N, 3], in metres.
        closed: whether the curve returns from the last point to the first one.
        fine: number of places between two points at which the curve's length is measured.
    """
    from scipy.interpolate import CubicSpline  # slow import: commands name a wrong key first

    knots = np.vstack([points, points[:1]]) if closed else points
    # Centripetal parameters avoid loops and cusps between points at uneven distances.
    steps = np.sqrt(np.linalg.norm(np.diff(knots[:, :2], axis=0), axis=1))
    parameter = np.concatenate([[0], np.cumsum(steps)])
    curve = CubicSpline(parameter, knots, bc_type="periodic" if closed else "not-a-knot")
    places = np.linspace(0, parameter[-1], fine * len(points) + 1)
    along = np.concatenate(
        [[0], np.cumsum(np.linalg.norm(np.diff(curve(places)[:, :2], axis=0), axis=1))]
    )
    length = float(along[-1])
    count = round(length / STEP_M)
    distance = np.arange(count + (not closed)) * length / count
    at = np.interp(distance, along, places)
    velocity, bend = curve(at, 1), curve(at, 2)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    return {
        "length": length,
        "distance": distance,
        "xyz": curve(at),
        "heading": np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0])),
        "curvature": (velocity[:, 0] * bend[:, 1] - velocity[:, 1] * bend[:, 0]) / speed**3,
        "grade": velocity[:, 2] / speed,
    }


def segment_points(segments: Segments) -> np.ndarray:
    """Return the points, float64 [N + 1, 3], at which segments begin, and the end of the last."""
    heading, here, points = 0.0, np.zeros(3), [np.zeros(3)]
    for length, turn, climb in segments:
        # The chord of an arc; np.sinc(x) is sin(pi x) / (pi x).
        chord = length * np.sinc(turn / (2 * np.pi))
        middle = heading + turn / 2
        here = here + (chord * np.cos(middle), chord * np.sin(middle), climb)
        heading += turn
        points.append(here)
    return np.array(points)


def follow_segments(segments: Segments, closed: bool) -> np.ndarray:
    """Return control points, float64 [N, 3], of segments, with smooth transitions between them."""
    from scipy.ndimage import uniform_filter1d  # slow import

    ends, turned, climbed = np.concatenate([np.zeros((1, 3)), np.cumsum(segments, 0)]).T
    stride = 2  # steps of integration from one control point to the next
    nodes = np.linspace(0, ends[-1], stride * max(round(ends[-1] / SEGMENT_STEP_M), 4) + 1)
    step = nodes[1]
    mode = "wrap" if closed else "nearest"
    curvature = np.diff(np.interp(nodes, ends, turned)) / step
    grade = np.diff(np.interp(nodes, ends, climbed)) / step
    for _ in range(2):  # twice, because a spline overshoots at the corners of a ramp
        curvature = uniform_filter1d(curvature, round(TRANSITION_M / 2 / step) | 1, mode=mode)
        grade = uniform_filter1d(grade, round(SLOPE_M / 2 / step) | 1, mode=mode)
    heading = np.cumsum(curvature) * step - curvature * step / 2
    moves = np.stack([np.cos(heading), np.sin(heading), grade], -1) * step
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(moves, 0)])
    points = points[::stride]
    return _close(points, np.arange(len(points))) if closed else points


def survey_points(survey: np.ndarray, closed: bool) -> np.ndarray:
    """Return the points, float64 [N + 1, 3], of a survey's rows, and the end of the last piece.

    Args:
        survey: float64 [N, 3]: station in metres, heading of the next piece in degrees
            (counter-clockwise from east), height in metres.
        closed: whether the last piece returns to the first point. A survey does not state that
            piece's length; it is the one that ends nearest to the first point.
    """
    steps = np.diff(survey[:, 0])
    heading = np.radians(survey[:, 1])
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:, None] * ahead[:-1], 0)])
    if not closed:
        return np.column_stack([xy, survey[:, 2]])
    last = float(np.clip(-xy[-1] @ ahead[-1], 0.5 * steps[-1], 1.5 * steps[-1]))
    end = [*(xy[-1] + last * ahead[-1]), survey[0, 2]]
    return np.vstack([np.column_stack([xy, survey[:, 2]]), end])


def follow_survey(survey: np.ndarray, closed: bool) -> np.ndarray:
    """Return control points, float64 [N, 3], of a survey; a loop's gap is spread over it."""
    points = survey_points(survey, closed)
    if closed:
        steps = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
        points = _close(points, np.concatenate([[0], np.cumsum(steps)]))
    return _smooth(points, closed)


def _smooth(points: np.ndarray, closed: bool) -> np.ndarray:
    """Return points, float64 [N, 3], with smaller third differences (Whittaker's smoothing)."""
    from scipy.sparse import coo_array, eye_array  # slow import
    from scipy.sparse.linalg import spsolve

    count = len(points)
    rows = np.arange(count if closed else count - 3)
    values = np.repeat([-1.0, 3.0, -3.0, 1.0], len(rows))
    columns = np.concatenate([(rows + offset) % count for offset in range(4)])
    third = coo_array((values, (np.tile(rows, 4), columns)), (len(rows), count)).tocsc()
    smooth = spsolve(eye_array(count, format="csc") + SMOOTHING * third.T @ third, points)
    return np.round(smooth, 6)  # BLAS differs between processors by 1e-12 m, which moves pixels


def _close(points: np.ndarray, stations: np.ndarray) -> np.ndarray:
    """Return all points but the last, moved so that the last one would equal the first one."""
    return (points - (points[-1] - points[0]) * (stations / stations[-1])[:, None])[:-1]


def near_parts(
    centreline: dict, half_widths: np.ndarray, closed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return where separate parts of the road are too near each other, seen from above.

    Returns:
        Pairs of samples, int [M, 2], and the distances that they need, float64 [M], in metres.

    Raises:
        ValueError: the road passes itself too often to list the pairs.
    """
    from scipy.spatial import cKDTree  # slow import

    stride = 4
    numbers = np.arange(0, len(centreline["distance"]), stride)
    xy = centreline["xyz"][numbers, :2]
    widest = 2 * half_widths.max() + VERGE_M
    _, in_cell = np.unique(np.floor(xy / widest), axis=0, return_counts=True)
    if (in_cell**2).sum() > MOST_PAIRS:
        raise ValueError("the road passes itself too often")
    pairs = numbers[cKDTree(xy).query_pairs(widest, output_type="ndarray")].reshape(-1, 2)
    first, second = pairs.T
    along = centreline["distance"][second] - centreline["distance"][first]
    if closed:
        along = np.minimum(along, centreline["length"] - along)
    room = half_widths[first] + half_widths[second] + VERGE_M
    apart = np.linalg.norm(centreline["xyz"][first, :2] - centreline["xyz"][second, :2], axis=1)
    # Nearer along the road they belong to the same bend.
    is_near = (along >= np.pi * room) & (apart < room)
    return pairs[is_near], room[is_near]


def bridge_samples(upper: np.ndarray, count: int, closed: bool) -> np.ndarray:
    """Return bool [count]: which samples stand on a bridge, given samples above a road."""
    reach = round(BRIDGE_END_M / STEP_M)
    around = upper[:, None] + np.arange(-reach, reach + 1)
    bridge = np.zeros(count, bool)
    bridge[around % count if closed else np.clip(around, 0, count - 1)] = True
    return bridge


def closing_segments(segments: list[dict], radius: float) -> list[dict]:
    """Return an arc, a straight and an arc that lead from the end of a road back to its start.

    Args:
        segments: segments of a track's file; the first one begins at the origin, to the east.
        radius: radius of both arcs in metres.

    Returns:
        The shortest such way, without arcs and straights that are too short; empty if none exists.
    """
    point, heading = end_of(segments)
    turns = product((1, -1), repeat=2)
    ways = [way for pair in turns if (way := _arc_straight_arc(point, heading, radius, *pair))]
    content = []
    for kind, size in min(ways, key=partial(_total, radius), default=()):
        if kind == "straight" and size >= 1:
            content.append({kind: size})
        elif kind != "straight" and size >= LEAST_TURN:
            content.append({kind: math.degrees(size), "radius": radius})
    return content


def end_of(segments: list[dict]) -> tuple[complex, float]:
    """Return the end of segments as a complex number of metres, and the heading in radians."""
    point, heading = 0j, 0.0
    for segment in segments:
        if "straight" in segment:
            point += segment["straight"] * cmath.exp(1j * heading)
            continue
        side, way = ("left", 1) if "left" in segment else ("right", -1)
        turn = way * math.radians(segment[side])
        centre = point + way * segment["radius"] * 1j * cmath.exp(1j * heading)
        point = centre + (point - centre) * cmath.exp(1j * turn)
        heading += turn
    return point, heading


def _arc_straight_arc(
    point: complex, heading: float, radius: float, first: int, last: int
) -> list[tuple[str, float]]:
    """Return arc, straight and arc from a pose to the origin's, to the east; empty if impossible.

    Args:
        point: start of the way in metres.
        heading: heading there in radians.
        radius: radius of the arcs in metres.
        first: 1 if the first arc turns left, -1 if right.
        last: the same of the last arc.
    """
    begin = point + first * radius * 1j * cmath.exp(1j * heading)
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


def _total(radius: float, way: list[tuple[str, float]]) -> float:
    return sum(size if kind == "straight" else size * radius for kind, size in way)
