"""Keys of a track's file that give its centreline: points, segments or a survey, and its widths."""

import math
from pathlib import Path

import numpy as np

from simulator.centreline import (
    CLEARANCE_M,
    Segment,
    bridge_samples,
    follow_segments,
    follow_survey,
    make_centreline,
    near_parts,
    segment_points,
    survey_points,
)
from simulator.rig import MAX_STEERING_DEG, REAR_AXLE_M, WHEELBASE_M
from simulator.yaml_values import check_keys, is_finite, read_number, read_rows
from zoo.base.bounded_files import MOST_YAML_BYTES, read_text
from zoo.base.errors import InputError

COLUMNS = ("station_m", "heading_deg", "height_m")
MOST_POINTS = 10_000  # rows of a survey, and points or segments of a track
KINDS = ("points", "segments", "survey")
CENTRELINE_KEYS = (*KINDS, "closed", "width", "widths")
# The radius of the car's tightest circle, at the car's origin between the axles.
TIGHTEST_RADIUS_M = math.hypot(WHEELBASE_M / math.tan(math.radians(MAX_STEERING_DEG)), REAR_AXLE_M)
SEGMENTS = ("straight", "left", "right")
CLOSING_M = 1.0  # largest gap between the end of a loop's last piece and its first point
# Limits that keep the centreline and the ground within memory.
MOST_LENGTH_M, MOST_SIDE_M = 100_000, 10_000
SHORTEST_M = 20.0  # length of an open road
MOST_DEGREES = 3_600.0  # turned by one segment
WIDTHS = 3.0, 30.0


def read_survey(given: object, folder: Path) -> np.ndarray:
    """Return a survey's rows, float64 [N, 3]: station, heading in degrees, height.

    Args:
        given: value of the key `survey`: the path of a .csv file.
        folder: folder of the track's file; the survey must lie in or below it.

    Raises:
        InputError: the file cannot be read, or a row is wrong.
    """
    place = f"survey: {given}"
    if not isinstance(given, str) or "\0" in given or Path(given).is_absolute():
        raise InputError(f"{place}; must be a .csv file in the folder of this file")
    path = folder / given
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError) as error:  # such as a loop of links
        raise InputError(f"{place}: {error}") from None
    if not is_inside:
        raise InputError(f"{place}: lies outside of the folder of this file; copy it there")
    lines = read_text(path, MOST_YAML_BYTES).splitlines()
    numbered = [(at, line) for at, line in enumerate(lines, start=1) if line.strip()]
    numbered = [(at, line) for at, line in numbered if not line.startswith("#")]
    if not numbered or tuple(numbered[0][1].replace(" ", "").split(",")) != COLUMNS:
        raise InputError(f"{place}: the first row must be {','.join(COLUMNS)}")
    survey = np.array([_row(place, at, line) for at, line in numbered[1:]]).reshape(-1, 3)
    if not 4 <= len(survey) <= MOST_POINTS:
        raise InputError(f"{place}: {len(survey):,} rows; must have 4..{MOST_POINTS:,}")
    steps = np.diff(survey[:, 0])
    if steps.min() < 1:
        at = numbered[1 + int(steps.argmin()) + 1][0]
        raise InputError(f"{place}: line {at}: each station must be 1 m or more after the last")
    return survey


def _row(place: str, at: int, line: str) -> list[float]:
    try:
        values = [float(cell) for cell in line.split(",")]
    except ValueError:
        values = []
    if len(values) != len(COLUMNS) or not all(is_finite(value) for value in values):
        raise InputError(f"{place}: line {at}: {line[:80]!r}; must be three numbers")
    return values


def read_centreline(content: dict, closed: bool, folder: Path) -> dict:
    """Return `Track`'s arrays, length and width from a file's content.

    Args:
        content: content of the track's file.
        closed: whether the road is a closed loop.
        folder: folder of the track's file, in which a survey lies.

    Raises:
        InputError: a value is wrong, a loop does not close, a bend is too tight for the car,
            or two parts of the road are too near each other.
    """
    kinds = [kind for kind in KINDS if content.get(kind) is not None]
    if len(kinds) > 1:
        raise InputError(f"{kinds[1]}: {kinds[0]} is given, too; keep one of them")
    kind = kinds[0] if kinds else "points"
    if kind == "segments":
        segments = _segments(content["segments"])
        _check_extent(kind, segment_points(segments), closed=False)
        if closed:
            _check_closing(segments)
        points, fine = follow_segments(segments, closed), 20
    elif kind == "survey":
        survey = read_survey(content["survey"], folder)
        kind = f"survey {content['survey']}"
        reckoned = survey_points(survey, closed)
        _check_extent(kind, reckoned, closed=False)
        if closed:
            _check_gap(kind, *(reckoned[-1] - reckoned[0])[:2])
        points, fine = follow_survey(survey, closed), 200
    else:
        points, fine = _points(content.get("points"), closed), 200
    centreline = make_centreline(points, closed, fine)
    if centreline["length"] > MOST_LENGTH_M:
        raise InputError(_too_long(kind, centreline["length"]))
    _check_bends(kind, centreline)
    usual, widths = _widths(content, centreline, closed)
    bridge = _bridges(kind, centreline, widths / 2, closed)
    return {**centreline, "closed": closed, "width": usual, "widths": widths, "bridge": bridge}


def _points(given: object, closed: bool) -> np.ndarray:
    points = read_rows("points", given, 3, "[x, y, z]")
    if closed and len(points) < 4:
        raise InputError(f"points: {len(points)} points; a closed loop needs 4 or more")
    if len(points) < 2:
        raise InputError(f"points: {len(points)} points; an open road needs 2 or more")
    if len(points) > MOST_POINTS:
        raise InputError(f"points: {len(points):,} points; use at most {MOST_POINTS:,}")
    _check_extent("points", points, closed)
    ends = points[:1] if closed else points[:0]
    steps = np.linalg.norm(np.diff(np.vstack([points, ends]), axis=0)[:, :2], axis=1)
    if steps.min() < 1:
        where = int(steps.argmin()) + 1
        advice = "; the loop closes by itself, so do not repeat the first one" if closed else ""
        raise InputError(
            f"points: numbers {where} and {where % len(points) + 1} are less than 1 m apart{advice}"
        )
    return points


def _segments(given: object) -> list[Segment]:
    if not isinstance(given, list) or not given:
        raise InputError("segments: must be a list such as [{straight: 80}, {left: 45, ...}]")
    if len(given) > MOST_POINTS:
        raise InputError(f"segments: {len(given):,} segments; use at most {MOST_POINTS:,}")
    return [_segment(f"segments, number {at}", one) for at, one in enumerate(given, start=1)]


def _segment(place: str, given: object) -> Segment:
    ways = [
        way for way in ("straight", "left", "right") if isinstance(given, dict) and way in given
    ]
    if len(ways) != 1:
        raise InputError(
            f"{place}: {given}; must have one of straight (metres), left or right (degrees, with "
            "radius)"
        )
    way = ways[0]
    known = (way, "climb") if way == "straight" else (way, "radius", "climb")
    check_keys(f"{place}: ", given, known)
    climb = read_number(f"{place}: climb", given.get("climb", 0), -1e4, 1e4)
    if way == "straight":
        return Segment(
            read_number(f"{place}: straight", given[way], 0.1, MOST_LENGTH_M), 0.0, climb
        )
    degrees = read_number(f"{place}: {way}", given[way], 0.1, MOST_DEGREES)
    radius = read_number(f"{place}: radius", given.get("radius"), 1, MOST_SIDE_M)
    turn = math.radians(degrees)
    return Segment(radius * turn, turn if way == "left" else -turn, climb)


def _check_closing(segments: list[Segment]) -> None:
    """Raise InputError for segments whose end is not their start."""
    gap = segment_points(segments)[-1]
    _check_gap("segments", gap[0], gap[1])
    turned = math.degrees(sum(one.turn for one in segments))
    if abs(turned / 360 - round(turned / 360)) * 360 > 2:
        raise InputError(
            f"segments: the road turns {turned:.1f} degrees to the left; a closed loop turns a "
            "multiple of 360: change a bend, or set closed: false"
        )
    if abs(gap[2]) > CLOSING_M:
        raise InputError(
            f"segments: the road ends {gap[2]:+.1f} m above its start; a closed loop needs a sum "
            f"of climbs of 0, within {CLOSING_M:g} m"
        )


def _check_gap(kind: str, x: float, y: float) -> None:
    gap = math.hypot(x, y)
    if gap > CLOSING_M:
        raise InputError(
            f"{kind}: the road ends {gap:.1f} m from its start (east {x:+.1f}, north {y:+.1f}); "
            f"a closed loop may leave {CLOSING_M:g} m: correct it, or set closed: false"
        )


def _check_extent(kind: str, points: np.ndarray, closed: bool) -> None:
    """Raise InputError for points that would need gigabytes of memory."""
    sides = np.ptp(points[:, :2], axis=0)
    if sides.max() > MOST_SIDE_M:
        raise InputError(
            f"{kind}: extend over {sides.max():,.0f} m, more than {MOST_SIDE_M:,} m; give them in "
            "metres"
        )
    ends = points[:1] if closed else points[:0]
    length = np.linalg.norm(np.diff(np.vstack([points, ends]), axis=0), axis=1).sum()
    if length > MOST_LENGTH_M:
        raise InputError(_too_long(kind, length))
    if not closed and length < SHORTEST_M:
        raise InputError(f"{kind}: the road is {length:.0f} m long; needs {SHORTEST_M:.0f} m")


def _too_long(kind: str, length: float) -> str:
    return f"{kind}: the road is {length:,.0f} m long, more than {MOST_LENGTH_M:,} m; shorten it"


def _check_bends(kind: str, centreline: dict) -> None:
    tightest = int(np.abs(centreline["curvature"]).argmax())
    radius = 1 / max(abs(centreline["curvature"][tightest]), 1e-9)
    if radius < TIGHTEST_RADIUS_M:
        raise InputError(
            f"{kind}: the bend at {centreline['distance'][tightest]:.0f} m has a radius of "
            f"{radius:.1f} m; the car needs {TIGHTEST_RADIUS_M:.1f} m: make the bend wider"
        )


def _widths(content: dict, centreline: dict, closed: bool) -> tuple[float, np.ndarray]:
    """Return the usual width and the width at each sample, in metres."""
    given = content.get("widths")
    distance, length = centreline["distance"], centreline["length"]
    if given is None:
        usual = read_number("width", content.get("width", 6.4), *WIDTHS)
        return usual, np.full(len(distance), usual)
    table = read_rows("widths", given, 2, "[station, width]")
    if not 1 <= len(table) <= MOST_POINTS:
        raise InputError(f"widths: {len(table):,} rows; must have 1..{MOST_POINTS:,}")
    for at, (station, width) in enumerate(table.tolist(), start=1):
        read_number(f"widths, number {at}: station", station, 0, length)
        read_number(f"widths, number {at}: width", width, *WIDTHS)
    late = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if len(late):
        raise InputError(f"widths, number {late[0] + 2}: stations must increase")
    period = length if closed else None
    widths = np.interp(distance, table[:, 0], table[:, 1], period=period)
    usual = content.get("width")
    if usual is None:
        return float(widths.mean()), widths
    return read_number("width", usual, *WIDTHS), widths


def _bridges(kind: str, centreline: dict, half_widths: np.ndarray, closed: bool) -> np.ndarray:
    """Return which samples stand on a bridge; raise InputError for parts that collide."""
    try:
        pairs, room = near_parts(centreline, half_widths, closed)
    except ValueError as error:
        raise InputError(f"{kind}: {error}; shorten it") from None
    first, second = pairs.T
    xyz, distance = centreline["xyz"], centreline["distance"]
    above = xyz[first, 2] - xyz[second, 2]
    collide = np.abs(above) < CLEARANCE_M
    if collide.any():
        apart = np.linalg.norm(xyz[first, :2] - xyz[second, :2], axis=1)
        worst = int(np.where(collide, room - apart, -1).argmax())
        raise InputError(
            f"{kind}: the road crosses itself, or nearly: {distance[first[worst]]:.0f} m and "
            f"{distance[second[worst]]:.0f} m along it are {apart[worst]:.1f} m apart and need "
            f"{room[worst]:.1f} m, or {CLEARANCE_M:g} m of height for a bridge, not "
            f"{abs(above[worst]):.1f} m"
        )
    return bridge_samples(np.where(above > 0, first, second), len(distance), closed)
