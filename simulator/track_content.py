"""A track from the content of its YAML file."""

from pathlib import Path

import numpy as np

from simulator.centreline_keys import CENTRELINE_KEYS, read_centreline
from simulator.track import Stretch, Surroundings, Track, Verge
from simulator.yaml_values import (
    check_choice,
    check_keys,
    read_boolean,
    read_number,
    read_rows,
    value_or,
)
from zoo.base.errors import InputError

PAVINGS = ("asphalt", "cobbles")
VERGES = ("paved", "kerb", "stripes", "dirt", "wall", "rock", "drop")
KEYS = (*CENTRELINE_KEYS, "shoulder", "centre_line", "verge", "stretches", "surroundings")
# Smallest values; 0 for other surroundings.
LEAST = {"water_level": -1e4, "hill_size": 1.0, "sun_lift_deg": -90.0}
MOST_CIRCLES, MOST_RADIUS_M = 100, 2_000  # limits that keep the ground within memory


def make_track(name: str, content: dict, folder: Path = Path()) -> Track:
    """Return the track of a YAML file's content.

    Args:
        name: name of the track.
        content: content of the file.
        folder: folder of the file, in which a survey lies.

    Raises:
        InputError: a key or value is wrong, a bend is too tight for the car, or the road
            crosses itself at one height.
    """
    if not isinstance(content, dict):
        raise InputError("has no keys; see conf/track/zoo_lake.yaml for an example")
    check_keys("", content, KEYS)
    closed = read_boolean("closed", content.get("closed", True))
    centreline = read_centreline(content, closed, folder)
    verge = _verge("verge", value_or(content, "verge", {}), Verge())
    listed = value_or(content, "stretches", [])
    if not isinstance(listed, list):
        raise InputError("stretches: must be a list of {from: and to: in metres}")
    stretches = tuple(
        _stretch(at, one, verge, centreline["length"]) for at, one in enumerate(listed, start=1)
    )
    return Track(
        name=name,
        shoulder=read_number("shoulder", content.get("shoulder", 1.4), 0, 10),
        centre_line=read_boolean("centre_line", content.get("centre_line", False)),
        stretches=stretches,
        verge=verge,
        surroundings=_surroundings(value_or(content, "surroundings", {})),
        **centreline,
    )


def _stretch(number: int, given: dict, usual: Verge, length: float) -> Stretch:
    place = f"stretches, number {number}"
    if not isinstance(given, dict):
        raise InputError(f"{place}: must have from: and to: in metres")
    check_keys(f"{place}: ", given, ("from", "to", "paving", "left", "right"))
    start = read_number(f"{place}: from", given.get("from"), 0, length)
    end = read_number(f"{place}: to", given.get("to"), start, length)
    paving = given.get("paving", "asphalt")
    check_choice(f"{place}: paving", paving, PAVINGS)
    sides = {side: given[side] for side in ("left", "right") if side in given}
    return Stretch(start, end, paving, _verge(place, sides, usual))


def _verge(place: str, given: dict, usual: Verge) -> Verge:
    check_keys(f"{place}: ", given, ("left", "right"))
    sides = {"left": usual.left, "right": usual.right, **given}
    for side, kind in sides.items():
        check_choice(f"{place}: {side}", kind, VERGES)
    return Verge(**sides)


def _surroundings(given: dict) -> Surroundings:
    names = Surroundings.__dataclass_fields__
    check_keys("surroundings: ", given, tuple(names))
    values = dict(given)
    for key, value in given.items():
        if key == "ground":
            check_choice("surroundings: ground", value, ("sand", "grass", "forest"))
        elif key == "lakes":
            values[key] = _circles(key, value, 3, "[x, y, radius]")
        elif key == "mounds":
            values[key] = _circles(key, value, 4, "[x, y, radius, height]")
        else:
            number = read_number(f"surroundings: {key}", value, LEAST.get(key, 0), 1e4)
            kind = type(names[key].default)
            if kind(number) != number:
                raise InputError(f"surroundings: {key}: {value}; must be a whole number")
            values[key] = kind(number)
    return Surroundings(**values)


def _circles(key: str, value: object, columns: int, what: str) -> tuple[tuple[float, ...], ...]:
    """Return rows of x, y, radius and more columns, all in metres."""
    place = f"surroundings: {key}"
    rows = read_rows(place, value, columns, what)
    radius = rows[:, 2]
    if len(rows) > MOST_CIRCLES or radius.max(initial=0) > MOST_RADIUS_M:
        raise InputError(
            f"{place}: {len(rows):,} with radii up to {radius.max():,.0f} m; use at most "
            f"{MOST_CIRCLES}, with radii up to {MOST_RADIUS_M:,} m"
        )
    if (radius <= 0).any():
        number = int(np.argmax(radius <= 0))
        raise InputError(
            f"{place}, number {number + 1}: the radius is {radius[number]:g}; must be above 0"
        )
    return tuple(map(tuple, rows.tolist()))
