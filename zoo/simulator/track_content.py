"""A track from the content of its YAML file."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from zoo.base.bounded_files import MOST_YAML_BYTES, read_text
from zoo.base.errors import InputError
from zoo.simulator.centreline import (
    CLEARANCE_M,
    bridge_samples,
    follow_segments,
    follow_survey,
    make_centreline,
    near_parts,
    segment_points,
    survey_points,
)
from zoo.simulator.track import (
    MOST_LENGTH_M,
    Coordinate,
    Paving,
    Stretch,
    Surroundings,
    Track,
    Verge,
)
from zoo.simulator.udacity_car import MAX_STEERING_DEG, REAR_AXLE_M, WHEELBASE_M
from zoo.simulator.yaml_fields import Flag, Keys, number, read_keys

COLUMNS = ("station_m", "heading_deg", "height_m")
MOST_POINTS = 10_000  # rows of a survey, and points or segments of a track
KINDS = ("points", "segments", "survey")
# The radius of the car's tightest circle, at the car's origin between the axles.
TIGHTEST_RADIUS_M = math.hypot(WHEELBASE_M / math.tan(math.radians(MAX_STEERING_DEG)), REAR_AXLE_M)
CLOSING_M = 1.0  # largest gap between the end of a loop's last piece and its first point
LEAST_STEP_M = 1.0  # between two points of a track
MOST_SIDE_M = 10_000  # keeps the ground within memory
SHORTEST_M = 20.0  # length of a road

Bounded = Field(min_length=1, max_length=MOST_POINTS)
Degrees = Annotated[float, number(0.1, 3_600)]
Station = Annotated[float, number(0, MOST_LENGTH_M)]
Width = Annotated[float, number(3, 30)]


class Segment(Keys):
    """A straight, or an arc to the left or right: metres, degrees, and metres climbed."""

    straight: Annotated[float, number(0.1, MOST_LENGTH_M)] | None = None
    left: Degrees | None = None
    right: Degrees | None = None
    radius: Annotated[float, number(1, MOST_SIDE_M)] | None = None
    climb: Annotated[float, number(-1e4, 1e4)] = 0.0

    @model_validator(mode="after")
    def complete(self) -> "Segment":
        """Raise ValueError unless the segment is one straight, or one arc with a radius."""
        ways = [way for way in (self.straight, self.left, self.right) if way is not None]
        if len(ways) != 1 or (self.straight is None) != (self.radius is not None):
            raise ValueError("must have straight (metres), or left or right (degrees) and radius")
        return self

    @property
    def move(self) -> tuple[float, float, float]:
        """Return the length in metres, the radians turned to the left, and the metres climbed."""
        if self.straight is not None:
            return self.straight, 0.0, self.climb
        turn = math.radians(self.left or self.right or 0)
        return (self.radius or 0) * turn, turn if self.left else -turn, self.climb


class TrackKeys(Keys):
    """Keys of a track's file; see `docs/simulator.md`."""

    points: Annotated[list[tuple[Coordinate, Coordinate, Coordinate]], Bounded] | None = None
    segments: Annotated[list[Segment], Bounded] | None = None
    survey: str | None = None
    closed: Flag = True
    width: Width | None = None
    widths: Annotated[list[tuple[Station, Width]], Bounded] | None = None
    shoulder: Annotated[float, number(0, 10)] = 1.4
    centre_line: Flag = False
    verge: Verge = Verge()
    paving: Paving = "asphalt"
    stretches: tuple[Stretch, ...] = ()
    surroundings: Surroundings = Surroundings()


def road_content(points: Sequence[Sequence[float]], width: float | None = None) -> dict[str, Any]:
    """Return the content of a file for an open road through points.

    A point less than 1 m from the last one that is kept is left out.

    Args:
        points: x, y and, unless the road is level, z of each point, in metres.
        width: width of the road in metres, 3..30; None for a file's default.

    Raises:
        InputError: a point is no two or three numbers.
    """
    try:
        kept = list(points[:1])
        for point in points[1:]:
            # NaN is kept, and refused when the content is read
            if not math.dist(point[:2], kept[-1][:2]) < LEAST_STEP_M:
                kept.append(point)
    except (TypeError, ValueError):
        raise InputError("points: each must be x and y, or x, y and z, in metres") from None
    return {"points": [(*point, 0.0)[:3] for point in kept], "closed": False, "width": width}


def read_survey(given: str, folder: Path) -> np.ndarray:
    """Return a survey's rows, float64 [N, 3]: station, heading in degrees, height.

    Args:
        given: value of the key `survey`: the path of a .csv file.
        folder: folder of the track's file; the survey must lie in or below it.

    Raises:
        InputError: the file cannot be read, or a row is wrong.
    """
    place = f"survey: {given}"
    if "\0" in given or Path(given).is_absolute():
        raise InputError(f"{place}; must be a .csv file in the folder of this file")
    path = folder / given
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError) as error:  # such as a loop of links
        raise InputError(f"{place}: {error}") from None
    if not is_inside:
        raise InputError(f"{place}: lies outside of the folder of this file; copy it there")
    lines = read_text(path, MOST_YAML_BYTES).splitlines()
    first, *rows = [
        (at, line)
        for at, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ] or [(1, "")]
    if tuple(first[1].replace(" ", "").split(",")) != COLUMNS:
        raise InputError(f"{place}: the first row must be {','.join(COLUMNS)}")
    survey = np.array([_row(place, at, line) for at, line in rows])
    if not 4 <= len(rows) <= MOST_POINTS:
        raise InputError(f"{place}: {len(rows):,} rows; must have 4..{MOST_POINTS:,}")
    steps = np.diff(survey[:, 0])
    if steps.min() < 1:
        at = rows[int(steps.argmin()) + 1][0]
        raise InputError(f"{place}: line {at}: each station must be 1 m or more after the last")
    return survey


def _row(place: str, at: int, line: str) -> list[float]:
    try:
        values = [float(cell) for cell in line.split(",")]
    except ValueError:
        values = []
    if len(values) != len(COLUMNS) or not all(abs(value) < 1e9 for value in values):
        raise InputError(f"{place}: line {at}: {line[:80]!r}; must be three numbers")
    return values


def read_centreline(keys: TrackKeys, folder: Path, tightest_m: float = TIGHTEST_RADIUS_M) -> dict:
    """Return `Track`'s arrays, length and width from a file's keys.

    Args:
        keys: keys of the track's file.
        folder: folder of the track's file, in which a survey lies.
        tightest_m: smallest allowed radius of a bend.

    Raises:
        InputError: a value is wrong, a loop does not close, a bend is too tight for the car,
            or two parts of the road are too near each other.
    """
    kind, *others = [name for name in KINDS if getattr(keys, name) is not None] or ["points"]
    if others:
        raise InputError(f"{others[0]}: {kind} is given, too; keep one of them")
    closed, turned, fine, length = keys.closed, 0.0, 200, None
    follow: Callable[[bool], np.ndarray]
    if keys.segments is not None:
        moves, fine = [segment.move for segment in keys.segments], 20
        ends, turned = segment_points(moves), sum(turn for _, turn, _ in moves)
        length = sum(math.hypot(metres, climb) for metres, _, climb in moves)
        follow = partial(follow_segments, moves)
    elif keys.survey is not None:
        survey, kind = read_survey(keys.survey, folder), f"survey {keys.survey}"
        ends, follow = survey_points(survey, closed), partial(follow_survey, survey)
    else:
        points = _points(keys)
        ends, follow = np.vstack([points, points[:closed]]), lambda closed: points
    _check_extent(kind, ends, length)
    if closed:
        _check_closing(kind, ends[-1] - ends[0], math.degrees(turned))
    centreline = make_centreline(follow(closed), closed, fine)
    _check_bends(kind, centreline, tightest_m)
    usual, widths = _widths(keys, centreline)
    bridge = _bridges(kind, centreline, widths / 2, closed)
    return {**centreline, "closed": closed, "width": usual, "widths": widths, "bridge": bridge}


def _points(keys: TrackKeys) -> np.ndarray:
    points, least = np.array(keys.points or []).reshape(-1, 3), 4 if keys.closed else 2
    if len(points) < least:
        road = "a closed loop" if keys.closed else "an open road"
        raise InputError(f"points: {len(points)} points; {road} needs {least} or more")
    steps = np.diff(np.vstack([points, points[: keys.closed]]), axis=0)
    near = np.flatnonzero(np.hypot(steps[:, 0], steps[:, 1]) < LEAST_STEP_M)
    if len(near):
        raise InputError(
            f"points: numbers {near[0] + 1} and {(near[0] + 1) % len(points) + 1} are less than "
            f"{LEAST_STEP_M:g} m apart; a loop closes by itself, so do not repeat its first point"
        )
    return points


def _check_closing(kind: str, gap: np.ndarray, turned: float) -> None:
    """Raise InputError for a loop whose end is not its start; `turned` is in degrees."""
    away = math.hypot(gap[0], gap[1])
    for wrong, reason in (
        (
            away > CLOSING_M,
            f"ends {away:.1f} m from its start (east {gap[0]:+.1f}, north {gap[1]:+.1f}); a closed "
            f"loop may leave {CLOSING_M:g} m",
        ),
        (
            abs(turned / 360 - round(turned / 360)) * 360 > 2,
            f"turns {turned:.1f} degrees to the left; a closed loop turns a multiple of 360",
        ),
        (
            abs(gap[2]) > CLOSING_M,
            f"ends {gap[2]:+.1f} m above its start; a closed loop may leave {CLOSING_M:g} m",
        ),
    ):
        if wrong:
            raise InputError(f"{kind}: the road {reason}: correct it, or set closed: false")


def _check_extent(kind: str, points: np.ndarray, length: float | None) -> None:
    """Raise InputError for a short road, or for one that would need gigabytes.

    Args:
        kind: key of the points.
        points: points of the road, float64 [N, 3].
        length: length of the arcs between them in metres; None for straight lines.
    """
    side = np.ptp(points[:, :2], axis=0).max()
    if length is None:
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    if side > MOST_SIDE_M:
        raise InputError(f"{kind}: extend over {side:,.0f} m; use at most {MOST_SIDE_M:,} m")
    if not SHORTEST_M <= length <= MOST_LENGTH_M:
        raise InputError(
            f"{kind}: the road is {length:,.0f} m long; must be {SHORTEST_M:g}..{MOST_LENGTH_M} m"
        )


def _check_bends(kind: str, centreline: dict, tightest_m: float) -> None:
    tightest = int(np.abs(centreline["curvature"]).argmax())
    radius = 1 / max(abs(centreline["curvature"][tightest]), 1e-9)
    if radius < tightest_m:
        raise InputError(
            f"{kind}: the bend at {centreline['distance'][tightest]:.0f} m has a radius of "
            f"{radius:.1f} m; the car needs {tightest_m:.1f} m: make the bend wider"
        )


def _widths(keys: TrackKeys, centreline: dict) -> tuple[float, np.ndarray]:
    """Return the usual width and the width at each sample, in metres."""
    distance, length = centreline["distance"], centreline["length"]
    if keys.widths is None:
        usual = keys.width or 6.4
        return usual, np.full(len(distance), usual)
    station, width = np.array(keys.widths).T
    late = np.flatnonzero((np.diff(station, prepend=-1) <= 0) | (station > length))
    if len(late):
        raise InputError(
            f"widths, number {late[0] + 1}: station {station[late[0]]:g}; stations must increase, "
            f"up to the road's length, {length:.1f} m"
        )
    widths = np.interp(distance, station, width, period=length if keys.closed else None)
    return keys.width or float(widths.mean()), widths


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


def make_track(
    name: str,
    content: object,
    folder: Path = Path(),
    tightest_m: float = TIGHTEST_RADIUS_M,
) -> Track:
    """Return the track of a YAML file's content.

    Args:
        name: name of the track.
        content: content of the file.
        folder: folder of the file, in which a survey lies.
        tightest_m: smallest allowed radius of a bend; the car's own by default.

    Raises:
        InputError: a key or value is wrong, a bend is too tight for the car, or the road
            crosses itself at one height.
    """
    keys = read_keys(TrackKeys, content)
    centreline = read_centreline(keys, folder, tightest_m)
    stretches = []
    for at, stretch in enumerate(keys.stretches, start=1):
        if not stretch.start <= stretch.end <= centreline["length"]:
            most = f"{stretch.start:g}..{centreline['length']:g}"
            raise InputError(f"stretches, number {at}: to: {stretch.end:g}; must be in {most}")
        usual = {**dict(keys.verge), "paving": keys.paving}
        update = {key: usual[key] for key in usual.keys() - stretch.model_fields_set}
        stretches.append(stretch.model_copy(update=update))
    return Track(
        name=name,
        shoulder=keys.shoulder,
        centre_line=keys.centre_line,
        stretches=tuple(stretches),
        verge=keys.verge,
        paving=keys.paving,
        surroundings=keys.surroundings,
        **centreline,
    )
