"""A reader of tracks: `conf/track/<name>.yaml`, or a user's own YAML file."""

import difflib
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from simulator.errors import SimulatorError
from simulator.plain_yaml import read_yaml
from simulator.rig import MAX_STEERING_DEG, WHEELBASE_M
from simulator.track import Stretch, Surroundings, Track, Verge, make_centreline
from simulator.track_names import track_folder, track_names

PAVINGS = ("asphalt", "cobbles")
VERGES = ("paved", "kerb", "stripes", "dirt", "wall", "rock", "drop")
KEYS = ("width", "shoulder", "centre_line", "verge", "points", "stretches", "surroundings")
# The radius of the car's tightest circle, and a quarter more for corrections.
TIGHTEST_RADIUS_M = 1.25 * WHEELBASE_M / np.tan(np.radians(MAX_STEERING_DEG))
LEAST = {"water_level": -1e4, "hill_size": 1.0}  # smallest values; 0 for other surroundings
MOST_PATH = 4096  # characters of the path of a track's file
# Limits that keep the centreline and the ground within memory.
MOST_POINTS, MOST_LENGTH_M, MOST_SIDE_M = 10_000, 100_000, 10_000
MOST_LAKES, MOST_RADIUS_M = 100, 2_000
VERGE_M = 4.0  # smallest distance between the edges of two parts of the road


def read_track(name: str) -> Track:
    """Read a track by its name or by the path of its YAML file.

    Raises:
        SimulatorError: there is no such track or file, a key or value is wrong, a bend is too
            tight for the car, or the road crosses itself.
    """
    path = track_folder() / f"{name}.yaml"
    if name.endswith((".yaml", ".yml")):
        path = Path(name)
    if "\0" in name or len(name) > MOST_PATH or not path.exists():
        name = ascii(name[:MOST_PATH])[1:-1] if "\0" in name else name[:MOST_PATH]
        raise SimulatorError(
            f"there is no track {name}; available: {', '.join(track_names())}, or a .yaml file"
        )
    content = read_yaml(path)
    try:
        return make_track(path.stem, content)
    except SimulatorError as error:
        raise SimulatorError(f"{path}: {error}") from None


def make_track(name: str, content: dict) -> Track:
    """Return the track of a YAML file's content; raise the errors of `read_track`."""
    if not isinstance(content, dict):
        raise SimulatorError("has no keys; see conf/track/lake.yaml for an example")
    _check_keys("", content, KEYS)
    points = _points(content.get("points"))
    width = _number("width", content.get("width", 6.4), 3, 30)
    centreline = make_centreline(points)
    if centreline["length"] > MOST_LENGTH_M:
        raise SimulatorError(_too_long(centreline["length"]))
    _check_bends(centreline)
    _check_crossings(centreline, width)
    verge = _verge("verge", _given(content, "verge", {}), Verge())
    given = _given(content, "stretches", [])
    if not isinstance(given, list):
        raise SimulatorError("stretches: must be a list of {from: and to: in metres}")
    stretches = tuple(
        _stretch(number, one, verge, centreline["length"])
        for number, one in enumerate(given, start=1)
    )
    return Track(
        name=name,
        width=width,
        shoulder=_number("shoulder", content.get("shoulder", 1.4), 0, 10),
        centre_line=_boolean("centre_line", content.get("centre_line", False)),
        stretches=stretches,
        verge=verge,
        surroundings=_surroundings(_given(content, "surroundings", {})),
        **centreline,
    )


def _points(given: object) -> np.ndarray:
    points = _triples("points", given, "[x, y, z]")
    if len(points) < 4:
        raise SimulatorError(f"points: {len(points)} points; a closed loop needs 4 or more")
    _check_extent(points)
    steps = np.linalg.norm(np.diff(points, axis=0, append=points[:1])[:, :2], axis=1)
    if steps.min() < 1:
        where = int(steps.argmin()) + 1
        raise SimulatorError(
            f"points: numbers {where} and {where % len(points) + 1} are less than 1 m apart; "
            "the loop closes by itself, so do not repeat the first one"
        )
    return points


def _check_extent(points: np.ndarray) -> None:
    """Raise SimulatorError for points that would need gigabytes of memory."""
    if len(points) > MOST_POINTS:
        raise SimulatorError(f"points: {len(points):,} points; use at most {MOST_POINTS:,}")
    sides = np.ptp(points[:, :2], axis=0)
    if sides.max() > MOST_SIDE_M:
        raise SimulatorError(
            f"points: extend over {sides.max():,.0f} m, more than {MOST_SIDE_M:,} m; give them in "
            "metres"
        )
    length = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1).sum()
    if length > MOST_LENGTH_M:
        raise SimulatorError(_too_long(length))


def _too_long(length: float) -> str:
    return f"points: the road is {length:,.0f} m long, more than {MOST_LENGTH_M:,} m; shorten it"


def _check_bends(centreline: dict) -> None:
    tightest = int(np.abs(centreline["curvature"]).argmax())
    radius = 1 / max(abs(centreline["curvature"][tightest]), 1e-9)
    if radius < TIGHTEST_RADIUS_M:
        raise SimulatorError(
            f"points: the bend at {centreline['distance'][tightest]:.0f} m has a radius of "
            f"{radius:.1f} m; the car needs {TIGHTEST_RADIUS_M:.1f} m: move its points apart"
        )


def _check_crossings(centreline: dict, width: float) -> None:
    """Raise SimulatorError where two separate parts of the road are too near each other."""
    stride = 4
    xy, distance = centreline["xyz"][::stride, :2], centreline["distance"][::stride]
    room, length = width + VERGE_M, centreline["length"]
    tree = cKDTree(xy)
    least, place = room, None
    for first, near in enumerate(tree.query_ball_point(xy, room)):
        second = np.array(near)
        along = np.abs(distance[second] - distance[first])
        second = second[np.minimum(along, length - along) >= np.pi * room]
        if len(second):
            apart = np.linalg.norm(xy[second] - xy[first], axis=-1)
            if apart.min() < least:
                least, place = apart.min(), (distance[first], distance[second[apart.argmin()]])
    if place:
        raise SimulatorError(
            f"points: the road crosses itself, or nearly: {place[0]:.0f} m and "
            f"{place[1]:.0f} m along it are {least:.1f} m apart and need {room:.1f} m: "
            "move the points there apart"
        )


def _stretch(number: int, given: dict, usual: Verge, length: float) -> Stretch:
    place = f"stretches, number {number}"
    if not isinstance(given, dict):
        raise SimulatorError(f"{place}: must have from: and to: in metres")
    _check_keys(f"{place}: ", given, ("from", "to", "paving", "left", "right"))
    start = _number(f"{place}: from", given.get("from"), 0, length)
    end = _number(f"{place}: to", given.get("to"), start, length)
    paving = given.get("paving", "asphalt")
    _check_choice(f"{place}: paving", paving, PAVINGS)
    sides = {side: given[side] for side in ("left", "right") if side in given}
    return Stretch(start, end, paving, _verge(place, sides, usual))


def _verge(place: str, given: dict, usual: Verge) -> Verge:
    _check_keys(f"{place}: ", given, ("left", "right"))
    sides = {"left": usual.left, "right": usual.right, **given}
    for side, kind in sides.items():
        _check_choice(f"{place}: {side}", kind, VERGES)
    return Verge(**sides)


def _surroundings(given: dict) -> Surroundings:
    names = Surroundings.__dataclass_fields__
    _check_keys("surroundings: ", given, tuple(names))
    values = dict(given)
    for key, value in given.items():
        if key == "ground":
            _check_choice("surroundings: ground", value, ("sand", "forest"))
        elif key == "lakes":
            lakes = _triples("surroundings: lakes", value, "[x, y, radius]")
            if len(lakes) > MOST_LAKES or lakes[:, 2].max(initial=0) > MOST_RADIUS_M:
                raise SimulatorError(
                    f"surroundings: lakes: {len(lakes):,} with radii up to "
                    f"{lakes[:, 2].max():,.0f} m; use at most "
                    f"{MOST_LAKES}, with radii up to {MOST_RADIUS_M:,} m"
                )
            if (lakes[:, 2] <= 0).any():
                number = int(np.argmax(lakes[:, 2] <= 0))
                raise SimulatorError(
                    f"surroundings: lakes, number {number + 1}: the radius is "
                    f"{lakes[number, 2]:g}; must be above 0"
                )
            values[key] = tuple(map(tuple, lakes.tolist()))
        else:
            number = _number(f"surroundings: {key}", value, LEAST.get(key, 0), 1e4)
            kind = type(names[key].default)
            if kind(number) != number:
                raise SimulatorError(f"surroundings: {key}: {value}; must be a whole number")
            values[key] = kind(number)
    return Surroundings(**values)


def _given(content: dict, key: str, usual: dict | list) -> object:
    """Return a key's value; a key without a value counts as left out."""
    value = content.get(key)
    return usual if value is None else value


def _triples(place: str, given: object, what: str) -> np.ndarray:
    """Return float64 [n, 3] from a YAML list of rows of three finite numbers."""
    rows = given if isinstance(given, list) else [given]
    for number, row in enumerate(rows, start=1):
        numbers = row if isinstance(row, list) and len(row) == 3 else [None]
        if not all(_is_finite(one) for one in numbers):
            raise SimulatorError(
                f"{place}: each must be {what} in metres, not {row} (number {number})"
            )
    return np.array(rows, float).reshape(-1, 3)


def _is_finite(value: object) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) < 1e9


def _boolean(place: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise SimulatorError(f"{place}: {value!r}; must be true or false, without quotes")
    return value


def _check_keys(place: str, given: object, known: tuple[str, ...]) -> None:
    if not isinstance(given, dict):
        raise SimulatorError(f"{place}{given}; must be keys and values ({', '.join(known)})")
    for key in given:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"available: {', '.join(known)}"
            raise SimulatorError(f"{place}unknown key {key}; {hint}")


def _check_choice(place: str, value: object, known: tuple[str, ...]) -> None:
    if value not in known:
        raise SimulatorError(f"{place}: {value}; must be one of {', '.join(known)}")


def _number(place: str, value: object, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise SimulatorError(f"{place}: {value}; must be a number in {low:g}..{high:g}")
    return float(value)
