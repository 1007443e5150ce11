"""Roads by the thousand: a family of roads in `conf/road/<name>.yaml`, and a road for each seed.

A road is drawn as a track's file would describe it: segments, widths, verges, surroundings. It is
drawn again until the car can take it, so `alpine:17` is the same road on every machine.
"""

import functools
import hashlib
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from zoo.base.errors import InputError, placed_errors
from zoo.base.plain_files import mapped, read_like
from zoo.simulator.centreline import closing_segments
from zoo.simulator.track import GroundKind, Track, VergeKind
from zoo.simulator.track_content import MOST_POINTS, make_track
from zoo.simulator.track_names import DRAWN, family_names, road_folder
from zoo.simulator.yaml_fields import Keys, Number, number, read_keys

VERSION = 1  # of the drawing; another version would draw other roads from the same seeds
MOST_DRAWS = 300
# Limits of all draws of a road, in metres and in segments; the included families stay below them.
MOST_DRAWN_M, MOST_DRAWN_SEGMENTS = 600_000, 100_000
MOST_SEED = 2**31 - 1
DIGITS = {"trees": 0, "bushes": 0, "rocks": 0, "sun": 2, "brightness": 2}  # others have 1
LONGEST_M = 120.0  # length of a bend; one of a large radius turns less than `degrees`
SHORTEST_M = 10.0  # length of the last segment
TURNS = ("straight", "left", "right")  # keys of a segment that its length is proportional to
TURN_BACK_DEG = 60.0  # a road that has turned this far mostly turns back


Ends = tuple[Number, Number]
Share = Annotated[float, number(0, 1)]


def within(low: float, high: float) -> AfterValidator:
    """Return the mark of a range, `[smallest, largest]`, within limits."""

    def check(ends: tuple[float, float]) -> tuple[float, float]:
        if not low <= ends[0] <= ends[1] <= high:
            raise ValueError(f"must be [smallest, largest] within {low:g}..{high:g}")
        return ends

    return AfterValidator(check)


class Scenery(Keys):
    """Ranges of a road's surroundings, in the order in which they are drawn."""

    hills: Annotated[Ends, within(0, 200)]
    hill_size: Annotated[Ends, within(20, 500)]
    trees: Annotated[Ends, within(0, 2_000)]
    bushes: Annotated[Ends, within(0, 2_000)]
    rocks: Annotated[Ends, within(0, 500)]
    sun_turn_deg: Annotated[Ends, within(0, 360)]
    sun_lift_deg: Annotated[Ends, within(-37, 48)]
    sun: Annotated[Ends, within(0.3, 2)]
    brightness: Annotated[Ends, within(0.3, 2)]
    ground: Annotated[tuple[GroundKind, ...], Field(min_length=1)] = ("sand",)


class RoadFamily(Keys):
    """Ranges from which roads are drawn: the keys of its file, `path`, in `docs/simulator.md`."""

    _path: Path = Path()  # private, because it is no key
    length: Annotated[Ends, within(60, 20_000)]
    loop: Annotated[Ends, within(300, 20_000)]
    closed: Share
    straight: Annotated[Ends, within(1, 1_000)]
    straights: Share
    radius: Annotated[Ends, within(6, 1_000)]
    degrees: Annotated[Ends, within(1, 270)]
    grade: Annotated[Ends, within(-0.3, 0.3)]
    width: Annotated[Ends, within(3, 30)]
    widening: Annotated[float, number(0, 10)]
    shoulder: Annotated[Ends, within(0, 10)]
    centre_line: Share
    verges: dict[VergeKind, Annotated[float, number(0, 1e3)]]
    stretch: Annotated[Ends, within(5, 1_000)]
    cobbles: Share
    surroundings: Scenery

    @property
    def path(self) -> Path:
        """Return the family's file."""
        return self._path

    @property
    def name(self) -> str:
        """Return the name of the family's file."""
        return self._path.stem


def find_family(name: str) -> RoadFamily:
    """Read a family by its name or by the path of its YAML file.

    Raises:
        InputError: there is no such family, the file cannot be read, or a key or value is
            wrong.
    """
    path = Path(name) if name.endswith((".yaml", ".yml")) else road_folder() / f"{name}.yaml"
    if "\0" in name or not path.is_file():
        raise InputError(
            f"there is no family of roads {name!a}; available: {', '.join(family_names())}, or a "
            ".yaml file"
        )
    status = path.stat()
    return _read_family(path, (status.st_ino, status.st_mtime_ns, status.st_size))


@functools.lru_cache(maxsize=100)
def _read_family(path: Path, _version: tuple[int, ...]) -> RoadFamily:
    # Each of a suite's drives asks for its family.
    content = read_like(path, road_folder())
    with placed_errors(path):
        family = read_keys(RoadFamily, content)
        if not any(family.verges.values()):
            raise InputError("verges: give one kind or more a weight above 0")
    family._path = path
    return family


def draw_road(family: RoadFamily, seed: int) -> Track:
    """Return the road of a seed.

    Raises:
        InputError: the seed is not allowed, or the family's ranges give no road that the car
            can take.
    """
    return draw_content(family, seed)[1]


def draw_content(family: RoadFamily, seed: int) -> tuple[dict[str, Any], Track]:
    """Return the content of a file for the road of a seed, and the road; see `draw_road`."""
    if not 0 <= seed <= MOST_SEED:
        raise InputError(f"track={family.name}:{seed}: the number must be in 0..{MOST_SEED}")
    rng = np.random.default_rng((VERSION, seed))
    closed = bool(rng.random() < family.closed)
    reason, metres, segments, draws = "", 0.0, 0, 0
    while draws < MOST_DRAWS and metres < MOST_DRAWN_M and segments < MOST_DRAWN_SEGMENTS:
        draws += 1
        content = _draw(family, rng, closed)
        if content is None:
            metres += family.loop[0]
            continue
        metres += sum(map(_length, content["segments"]))
        segments += len(content["segments"])
        try:
            return content, make_track(f"{family.name}:{seed}", content)
        except InputError as error:
            reason = f" (the last one: {error})"
    raise InputError(
        f"track={family.name}:{seed}: the car could take none of {draws} drawn roads{reason}; "
        "widen the ranges of radius, degrees or straight, or shorten length and loop"
    )


def roads_digest(names: Iterable[str]) -> str:
    """Return 16 hex digits of the contents of roads, the same on every machine and in any order.

    Args:
        names: roads such as `alpine:17`. Names of tracks with a file are left out.

    >>> roads_digest(["alpine:17", "country:3"]) == roads_digest(["country:3", "alpine:17"])
    True
    """
    drawn = {name: DRAWN.fullmatch(name) for name in names}
    contents = {
        name: draw_content(find_family(parts[1]), int(parts[2]))[0]
        for name, parts in drawn.items()
        if parts
    }
    # Of 6 decimals, because machines differ in the last digits.
    rounded = mapped(lambda raw: round(raw, 6) + 0.0 if isinstance(raw, float) else raw, contents)
    canonical = json.dumps(rounded, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()[:16]


def _draw(family: RoadFamily, rng: np.random.Generator, closed: bool) -> dict[str, Any] | None:
    """Return one draw of a road, or None for a loop that cannot be closed within the ranges."""
    segments = _segments(family, rng, closed)
    if segments is None:
        return None
    length = sum(_length(segment) for segment in segments)
    width = rng.uniform(*family.width)
    stations = np.sort(rng.uniform(0, 0.98 * length, rng.integers(2, 6))).round(1)
    change = family.widening / 2 * rng.uniform(-1, 1, len(stations))
    widths = np.clip(width + change, *family.width).round(2)
    content: dict[str, Any] = {
        "closed": closed,
        "segments": segments,
        "width": round(width, 2),
        "shoulder": round(rng.uniform(*family.shoulder), 2),
        "centre_line": bool(rng.random() < family.centre_line),
        "stretches": _stretches(family, rng, length),
        "surroundings": _surroundings(family, rng),
    }
    if family.widening and np.diff(stations).min() > 1:
        content["widths"] = np.stack([stations, widths], -1).tolist()
    return content


def _segments(family: RoadFamily, rng: np.random.Generator, closed: bool) -> list[dict] | None:
    """Return segments of straights and bends; a loop mostly turns left and is closed at its end."""
    wanted = rng.uniform(*(family.loop if closed else family.length))
    turned, segments = 0.0, [_straight(family, rng)]
    along = _length(segments[0])
    while along < wanted and len(segments) <= MOST_POINTS:
        # A loop turns left steadily, an open road to both sides.
        aim = 300.0 * along / wanted if closed else 0.0
        left = rng.random() < 1 / (1 + math.exp((turned - aim) / TURN_BACK_DEG * 2))
        least, most = map(math.log, family.radius)
        radius = round(math.exp(rng.uniform(least, most)), 1)
        degrees = min(rng.uniform(*family.degrees), math.degrees(LONGEST_M / radius))
        segment = {"left" if left else "right": round(degrees, 1), "radius": radius}
        turned += segment["left"] if left else -segment["right"]
        segments.append(segment)
        along += _length(segment)
        if rng.random() < family.straights:
            segments.append(_straight(family, rng))
            along += _length(segments[-1])
    if not closed:
        segments = _cut(segments, wanted)
    low, high = family.grade
    for segment in segments:
        segment["climb"] = round(rng.uniform(low, high) * _length(segment), 2)
    if not closed:
        return segments
    ending = closing_segments(segments, rng.uniform(*family.radius))
    climb = -sum(segment["climb"] for segment in segments)
    room = sum(_length(segment) for segment in ending)
    if not ending or not low <= climb / room <= high or along + room > 1.3 * family.loop[1]:
        return None
    for segment in ending:
        segment["climb"] = climb * _length(segment) / room
    return [*segments, *ending]


def _cut(segments: list[dict], wanted: float) -> list[dict]:
    """Return the segments up to a length in metres; a last one under 10 m is left out."""
    kept, along = [], 0.0
    for segment in segments:
        share = min((wanted - along) / _length(segment), 1.0)
        if share < 1 and share * _length(segment) < SHORTEST_M:
            break
        turned = {key: round(share * segment[key], 1) for key in TURNS if key in segment}
        kept.append(segment | turned)
        along += _length(segment)
    return kept


def _straight(family: RoadFamily, rng: np.random.Generator) -> dict:
    return {"straight": round(rng.uniform(*family.straight), 1)}


def _length(segment: dict) -> float:
    """Return a segment's length in metres."""
    if "straight" in segment:
        return float(segment["straight"])
    degrees = segment["left"] if "left" in segment else segment["right"]
    return float(math.radians(degrees) * segment["radius"])


def _stretches(family: RoadFamily, rng: np.random.Generator, length: float) -> list[dict]:
    """Return stretches of verges over the road; some are cobbled bridges with walls."""
    kinds = list(family.verges)
    weights = np.array([family.verges[kind] for kind in kinds])
    stretches, start = [], 0.0
    # A road's smoothed length is a little shorter than that of its segments.
    while start < 0.9 * length:
        end = min(start + rng.uniform(*family.stretch), 0.95 * length)
        left, right = rng.choice(kinds, 2, p=weights / weights.sum()).tolist()
        stretch = {"from": round(start, 1), "to": round(end, 1), "left": left, "right": right}
        if rng.random() < family.cobbles:
            stretch |= {"paving": "cobbles", "left": "wall", "right": "wall"}
        stretches.append(stretch)
        start = end
    return stretches


def _surroundings(family: RoadFamily, rng: np.random.Generator) -> dict:
    ranges = {key: ends for key, ends in family.surroundings if key != "ground"}
    drawn = {key: round(rng.uniform(*ends), DIGITS.get(key, 1)) for key, ends in ranges.items()}
    grounds = family.surroundings.ground
    ground = grounds[int(rng.integers(len(grounds)))]
    return {"seed": int(rng.integers(10_000)), "ground": ground, **drawn}
