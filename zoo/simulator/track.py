"""A track: a closed loop or an open road, and the place of a car on it."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from zoo.simulator.centreline import STEP_M
from zoo.simulator.yaml_fields import Flag, Keys, Whole, number

REACH_M = 20.0  # a search near a place covers this distance along the road, both ways
# Limits that keep the centreline and the ground within memory.
MOST_LENGTH_M = 100_000
MOST_CIRCLES = Field(max_length=100)

LeafyKind = Literal["leaves", "cliff", "barriers", "closed"]
VergeKind = Literal["paved", "kerb", "stripes", "dirt", "wall", "rock", "drop", LeafyKind]
GroundKind = Literal["sand", "grass", "forest", "autumn"]
Paving = Literal["asphalt", "cobbles", "worn"]
LEAVES_M = 1.3  # width of a band of leaves
# Distance from the edge line at which verges stop a car; between barriers it does not fit either.
SOLID_M = {"wall": 0.7, "rock": 0.7, "cliff": LEAVES_M, "barriers": LEAVES_M + 0.1}
Size = Annotated[float, number(0, 1e4)]
Radius = Annotated[float, Field(gt=0), number(0, 2_000)]
Coordinate = Annotated[float, number(-1e9, 1e9)]


class Verge(Keys):
    """The kinds of ground beside the road, left and right.

    `paved`: shoulder, then grass. `kerb`: shoulder and pale kerb. `stripes`: red and white kerb.
    `dirt`: sand up to the asphalt, without an edge line. `wall`: low wall. `rock`: rock face.
    `drop`: steep descent.

    These begin with a band of fallen leaves. `leaves`: forest floor. `cliff`: upright rock face.
    `barriers`: striped barriers before a descent, with lamps, and signs in bends. `closed`: side
    road behind three barriers.
    """

    left: VergeKind = "paved"
    right: VergeKind = "paved"


WALLS = Verge(left="wall", right="wall")


class Stretch(Verge):
    """A part of the lap, in metres from the start, with another paving or verge."""

    start: Annotated[float, number(0, MOST_LENGTH_M)] = Field(alias="from")
    end: Annotated[float, number(0, MOST_LENGTH_M)] = Field(alias="to")
    paving: Paving = "asphalt"
    tunnel: Flag = False  # a roof, where no other part of the road is near


class Surroundings(Keys):
    """The landscape around the road; counts are for the whole world, lengths in metres."""

    seed: Whole = 1
    hills: Size = 14.0  # height of the highest hill above the road
    hill_size: Annotated[float, number(1, 1e4)] = 90.0
    calm: Size = 14.0  # distance from the centreline within which the ground is level
    # x, y, radius
    lakes: Annotated[tuple[tuple[Coordinate, Coordinate, Radius], ...], MOST_CIRCLES] = ()
    water_level: Annotated[float, number(-1e4, 1e4)] = -3.0
    # x, y, radius, height
    mounds: Annotated[
        tuple[tuple[Coordinate, Coordinate, Radius, Coordinate], ...], MOST_CIRCLES
    ] = ()
    sun_turn_deg: Size = 0.0  # added to every weather's azimuth of the sun
    sun_lift_deg: Annotated[float, number(-90, 1e4)] = 0.0  # added to every weather's elevation
    sun: Size = 1.0  # factor on every weather's sun
    brightness: Size = 1.0  # factor on every weather's brightness
    sky: tuple[Size, Size, Size] = (1.0, 1.0, 1.0)  # factors on the sky's red, green and blue
    kerb_width: Size = 1.8
    kerb_height: Size = 0.4
    stripes_width: Size = 1.6
    taper: Size = 0.0  # length over which a rock face or a drop begins and ends
    clear: Size = 10.5  # smallest distance of a tree from the centreline
    trees: Whole = 200
    bushes: Whole = 60
    rocks: Whole = 30
    poles: Whole = 0
    ground: GroundKind = "sand"


class Place(NamedTuple):
    """A place on the centreline, and a point's distance from it.

    Its numbers are plain floats: the car locates itself 50 times per second, and numpy is several
    times slower for single numbers.

    Attributes:
        distance: metres from the start along the road: in [0, length) on a closed loop, in
            [0, length] on an open road.
        heading: heading of the road there, in radians.
        curvature: curvature of the road there, in 1/m, left positive.
        grade: rise of the road there, per metre.
        x: metres to the east.
        y: metres to the north.
        z: height of the road there, in metres.
        width: width of the road there, in metres between the edge lines.
        cte: cross-track error of the point in metres, right of the centreline positive.
    """

    distance: float
    heading: float
    curvature: float
    grade: float
    x: float
    y: float
    z: float
    width: float
    cte: float = 0.0


@dataclass(frozen=True)
class Track:
    """A closed loop or an open road, sampled every `STEP_M`.

    x is east, y north and z up, in metres. Headings are in radians, counter-clockwise from east.
    Distances beyond a lap wrap on a closed loop; on an open road they are clamped to its ends.
    """

    name: str
    closed: bool
    length: float
    width: float  # the usual width between the edge lines; `widths` has it for each sample
    shoulder: float
    centre_line: bool
    stretches: tuple[Stretch, ...]
    verge: Verge
    paving: Paving  # outside of stretches
    surroundings: Surroundings
    distance: np.ndarray
    xyz: np.ndarray  # float64 [N, 3]
    heading: np.ndarray  # unwrapped
    curvature: np.ndarray
    grade: np.ndarray
    widths: np.ndarray  # float64 [N]
    bridge: np.ndarray  # bool [N]: the road passes over another part of itself

    def at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the centreline's x, y, z, float64 [..., 3], at distances."""
        return self.interpolate(self.xyz, distance)

    def heading_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the road's heading in radians, unwrapped over laps."""
        if not self.closed:
            return self.interpolate(self.heading, distance)
        laps, rest = np.divmod(distance, self.length)
        wrapped = np.append(self.heading, self.heading[0] + self._turned)
        return np.interp(rest, np.append(self.distance, self.length), wrapped) + laps * self._turned

    def curvature_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the curvature in 1/m, left bends positive."""
        return self.interpolate(self.curvature, distance)

    def grade_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the rise per metre, climbing positive."""
        return self.interpolate(self.grade, distance)

    def width_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the metres between the edge lines."""
        return self.interpolate(self.widths, distance)

    def wrap(self, distance: float) -> float:
        """Return a distance within the road: wrapped on a closed loop, else clamped."""
        return distance % self.length if self.closed else min(max(distance, 0.0), self.length)

    def begin(self, direction: int) -> float:
        """Return the distance at which a drive in a direction, 1 or -1, begins."""
        return 0.0 if self.closed or direction > 0 else self.length

    def stretch_at(self, distance: float) -> Stretch | None:
        """Return the stretch that covers a distance, or None outside of stretches."""
        rest = self.wrap(distance)
        return next(
            (stretch for stretch in self.stretches if stretch.start <= rest < stretch.end), None
        )

    def verge_at(self, distance: float) -> Verge:
        """Return the verges at a distance; a bridge has walls."""
        if self.on_bridge(distance):
            return WALLS
        return self.stretch_at(distance) or self.verge

    def on_bridge(self, distance: float) -> bool:
        """Return whether the road stands on a bridge at a distance."""
        pieces = len(self.distance) - (not self.closed)
        index = int(self.wrap(distance) / self.length * pieces)
        return bool(self.bridge[min(index, len(self.distance) - 1)])

    def locate(self, x: float, y: float, near: float | None = None) -> Place:
        """Return the place of a point; with `near`, search only 20 m around that distance."""
        x, y = float(x), float(y)
        if near is None:
            nearest = int(((self.xyz[:, :2] - (x, y)) ** 2).sum(1).argmin())
        else:
            nearest = self._nearest_sample(x, y, round(near / STEP_M))
        sample = self._samples[nearest]
        sin, cos = math.sin(sample.heading), math.cos(sample.heading)
        ahead = (x - sample.x) * cos + (y - sample.y) * sin
        distance = self.wrap(sample.distance + min(max(ahead, -STEP_M), STEP_M))
        if self.closed and distance == self.length:  # rounding error just before the start line
            distance = 0.0
        pieces = len(self._samples) - 1
        position = distance / self.length * pieces
        index = min(int(position), pieces - 1)
        part = position - index
        pair = zip(self._samples[index], self._samples[index + 1], strict=True)
        here = Place._make([before + (after - before) * part for before, after in pair])
        cte = (x - here.x) * math.sin(here.heading) - (y - here.y) * math.cos(here.heading)
        return here._replace(distance=distance, cte=cte)

    def _nearest_sample(self, x: float, y: float, middle: int) -> int:
        """Return the index of the sample nearest to a point, within 20 m along the road.

        If a sample is d further away than the nearest one so far, no sample within d of it along
        the road can be nearer. Therefore most samples are skipped.
        """
        samples, count = self._samples, len(self.distance)
        # 1 % longer than real, so that rounding skips no candidate
        step = 1.01 * self.length / (len(samples) - 1)
        if not self.closed:
            middle = min(max(middle, 0), count - 1)
        nearest, least = middle % count, math.inf
        for way, offset in ((1, 0), (-1, 1)):
            while offset <= REACH_M / STEP_M:
                index = middle + way * offset
                if not self.closed and not 0 <= index < count:
                    break
                index %= count
                sample = samples[index]
                away = math.hypot(x - sample.x, y - sample.y)
                if away < least:
                    nearest, least = index, away
                offset += int((away - least) / step) + 1
        return nearest

    @cached_property
    def rightwards(self) -> np.ndarray:
        """Return unit vectors, float64 [N, 2], to the right of the road at its samples."""
        return np.stack([np.sin(self.heading), -np.cos(self.heading)], -1)

    @cached_property
    def verge_kinds(self) -> np.ndarray:
        """Return the kinds of verge, text [2, N], to the left and the right of the samples."""
        verges = [self.verge_at(float(distance)) for distance in self.distance]
        return np.array([(verge.left, verge.right) for verge in verges]).T

    @cached_property
    def _samples(self) -> list[Place]:
        """Return all samples; on a closed loop also the first one again, a lap later."""
        columns = (self.distance, self.heading, self.curvature, self.grade, *self.xyz.T)
        samples = [Place(*row) for row in np.stack((*columns, self.widths), -1).tolist()]
        if not self.closed:
            return samples
        heading = samples[0].heading + self._turned
        return [*samples, samples[0]._replace(distance=self.length, heading=heading)]

    @cached_property
    def _turned(self) -> float:
        """Return the heading's change over a lap in radians: a full turn left or right."""
        return 2 * np.pi * round((self.heading[-1] - self.heading[0]) / (2 * np.pi))

    def interpolate(self, values: np.ndarray, distance: float | np.ndarray) -> np.ndarray:
        """Return values at distances, float64 [...], from those of the samples, [N] or [N, D]."""
        # Faster than np.interp with a period, which sorts all samples at each call.
        count = len(values)
        if self.closed:
            position = np.asarray(distance) % self.length * (count / self.length)
        else:
            position = np.clip(distance, 0, self.length) * ((count - 1) / self.length)
        index = position.astype(int)
        part = position - index
        if values.ndim > 1:
            part = part[..., None]
        return values[index % count] * (1 - part) + values[(index + 1) % count] * part
