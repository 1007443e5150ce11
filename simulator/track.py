"""A track: the centreline of a closed loop, and the place of a car on it."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

STEP_M = 0.5  # distance between samples of the centreline
REACH_M = 20.0  # a search near a place covers this distance along the road, both ways


@dataclass(frozen=True)
class Verge:
    """The kinds of ground beside the road, left and right.

    `paved`: shoulder, then grass. `kerb`: shoulder and pale kerb. `stripes`: red and white kerb.
    `dirt`: sand up to the asphalt, without an edge line. `wall`: low wall. `rock`: rock face.
    `drop`: steep descent.
    """

    left: str = "paved"
    right: str = "paved"


@dataclass(frozen=True)
class Stretch:
    """A part of the lap, in metres from the start, with another paving or verge."""

    start: float
    end: float
    paving: str = "asphalt"
    verge: Verge = field(default_factory=Verge)


@dataclass(frozen=True)
class Surroundings:
    """The landscape around the road; counts are for the whole world, lengths in metres."""

    seed: int = 1
    hills: float = 14.0  # height of the highest hill above the road
    hill_size: float = 90.0
    calm: float = 14.0  # distance from the centreline within which the ground is level
    lakes: tuple[tuple[float, float, float], ...] = ()  # x, y, radius
    water_level: float = -3.0
    clear: float = 10.5  # smallest distance of a tree from the centreline
    trees: int = 200
    bushes: int = 60
    rocks: int = 30
    poles: int = 0
    ground: str = "sand"  # sand or forest


@dataclass(frozen=True)
class Place:
    """A point's position relative to the centreline.

    Attributes:
        distance: metres from the start along the lap, in [0, length).
        cte: cross-track error in metres, right of the centreline positive.
        heading: heading of the road there, in radians.
        curvature: curvature of the road there, in 1/m, left positive.
        grade: rise of the road there, per metre.
        z: height of the road there, in metres.
    """

    distance: float
    cte: float
    heading: float
    curvature: float
    grade: float
    z: float


class Sample(NamedTuple):
    """One sample of the centreline, in plain floats.

    The car locates itself 50 times per second, and numpy is several times slower for single
    numbers.
    """

    distance: float
    heading: float
    curvature: float
    grade: float
    x: float
    y: float
    z: float


@dataclass(frozen=True)
class Track:
    """A closed loop, sampled every `STEP_M`.

    x is east, y north and z up, in metres. Headings are in radians, counter-clockwise from east.
    """

    name: str
    length: float
    width: float  # between the edge lines
    shoulder: float
    centre_line: bool
    stretches: tuple[Stretch, ...]
    verge: Verge
    surroundings: Surroundings
    distance: np.ndarray
    xyz: np.ndarray  # float64 [N, 3]
    heading: np.ndarray  # unwrapped
    curvature: np.ndarray
    grade: np.ndarray

    def at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the centreline's x, y, z, float64 [..., 3], at distances, also beyond a lap."""
        return self._periodic(self.xyz, distance)

    def heading_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the road's heading in radians, unwrapped over laps."""
        laps, rest = np.divmod(distance, self.length)
        wrapped = np.append(self.heading, self.heading[0] + self._turned)
        return np.interp(rest, np.append(self.distance, self.length), wrapped) + laps * self._turned

    def curvature_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the curvature in 1/m, left bends positive."""
        return self._periodic(self.curvature, distance)

    def grade_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return the rise per metre, climbing positive."""
        return self._periodic(self.grade, distance)

    def stretch_at(self, distance: float) -> Stretch | None:
        """Return the stretch that covers a distance, or None outside of stretches."""
        rest = distance % self.length
        return next((one for one in self.stretches if one.start <= rest < one.end), None)

    def verge_at(self, distance: float) -> Verge:
        """Return the verges at a distance."""
        stretch = self.stretch_at(distance)
        return stretch.verge if stretch else self.verge

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
        distance = (sample.distance + min(max(ahead, -STEP_M), STEP_M)) % self.length
        if distance == self.length:  # rounding error just before the start line
            distance = 0.0
        count = len(self.distance)
        position = distance / self.length * count
        index = min(int(position), count - 1)
        part = position - index
        pair = zip(self._samples[index], self._samples[index + 1], strict=True)
        here = Sample._make([before + (after - before) * part for before, after in pair])
        cte = (x - here.x) * math.sin(here.heading) - (y - here.y) * math.cos(here.heading)
        return Place(distance, cte, here.heading, here.curvature, here.grade, here.z)

    def _nearest_sample(self, x: float, y: float, middle: int) -> int:
        """Return the index of the sample nearest to a point, within 20 m along the road.

        If a sample is d further away than the nearest one so far, no sample within d of it along
        the road can be nearer. Therefore most samples are skipped.
        """
        samples, count = self._samples, len(self.distance)
        step = (
            1.01 * self.length / count
        )  # 1 % longer than real, so that rounding skips no candidate
        nearest, least = middle % count, math.inf
        for way, offset in ((1, 0), (-1, 1)):
            while offset <= REACH_M / STEP_M:
                index = (middle + way * offset) % count
                sample = samples[index]
                away = math.hypot(x - sample.x, y - sample.y)
                if away < least:
                    nearest, least = index, away
                offset += int((away - least) / step) + 1
        return nearest

    @cached_property
    def _samples(self) -> list[Sample]:
        """Return all samples, and the first one again, a lap later."""
        columns = (self.distance, self.heading, self.curvature, self.grade, *self.xyz.T)
        samples = [Sample(*row) for row in np.stack(columns, -1).tolist()]
        heading = samples[0].heading + self._turned
        return [*samples, samples[0]._replace(distance=self.length, heading=heading)]

    @cached_property
    def _turned(self) -> float:
        """Return the heading's change over a lap in radians: a full turn left or right."""
        return 2 * np.pi * round((self.heading[-1] - self.heading[0]) / (2 * np.pi))

    def _periodic(self, values: np.ndarray, distance: float | np.ndarray) -> np.ndarray:
        # Faster than np.interp with a period, which sorts all samples at each call.
        count = len(values)
        position = np.asarray(distance) % self.length * (count / self.length)
        index = position.astype(int)
        part = position - index
        if values.ndim > 1:
            part = part[..., None]
        return values[index % count] * (1 - part) + values[(index + 1) % count] * part


def make_centreline(points: np.ndarray) -> dict[str, np.ndarray | float]:
    """Return `Track`'s arrays of a smooth closed curve through control points, float64 [N, 3]."""
    closed = np.vstack([points, points[:1]])
    # Centripetal parameters avoid loops and cusps between points at uneven distances.
    steps = np.sqrt(np.linalg.norm(np.diff(closed[:, :2], axis=0), axis=1))
    parameter = np.concatenate([[0], np.cumsum(steps)])
    curve = CubicSpline(parameter, closed, bc_type="periodic")
    fine = np.linspace(0, parameter[-1], 200 * len(points) + 1)
    along = np.concatenate(
        [[0], np.cumsum(np.linalg.norm(np.diff(curve(fine)[:, :2], axis=0), axis=1))]
    )
    length = float(along[-1])
    count = round(length / STEP_M)
    distance = np.arange(count) * length / count
    at = np.interp(distance, along, fine)
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
