"""A track: a closed loop's centreline, and where on it a car is."""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

STEP_M = 0.5  # between the samples of the centreline


@dataclass(frozen=True)
class Verge:
    """What lies beside the road on one side.

    `paved`: a shoulder, then grass. `kerb`: a shoulder and a pale kerb. `stripes`: a red-white
    kerb. `dirt`: sand up to the asphalt, and no line. `wall`: a low wall. `rock`: a rock face.
    `drop`: the ground falls away.
    """

    left: str = "paved"
    right: str = "paved"


@dataclass(frozen=True)
class Stretch:
    """A part of the lap, in metres from the start, that differs from the rest."""

    start: float
    end: float
    paving: str = "asphalt"
    verge: Verge = field(default_factory=Verge)


@dataclass(frozen=True)
class Surroundings:
    """What stands around the road; counts are for the whole world, lengths in metres."""

    seed: int = 1
    hills: float = 14.0  # height of the highest, above the road
    hill_size: float = 90.0
    calm: float = 14.0  # ground beside the road that stays level, from the centreline
    lakes: tuple[tuple[float, float, float], ...] = ()  # x, y, radius
    water_level: float = -3.0
    clear: float = 10.5  # no tree stands nearer to the centreline
    trees: int = 200
    bushes: int = 60
    rocks: int = 30
    poles: int = 0
    ground: str = "sand"  # sand or forest


@dataclass(frozen=True)
class Place:
    """Where a point lies beside the centreline.

    `distance`: metres from the start along the lap, in [0, length). `cte`: the cross-track
    error in metres, right of the centreline positive. `heading`, `curvature` (1/m, left
    positive), `grade` (rise per metre) and `z` are the road's there.
    """

    distance: float
    cte: float
    heading: float
    curvature: float
    grade: float
    z: float


@dataclass(frozen=True)
class Track:
    """A closed loop, sampled every `STEP_M`; x east, y north, z up, metres; heading in radians
    counter-clockwise from east."""

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
        """x, y and z float64 [..., 3] of the centreline at a distance, which may exceed a lap."""
        return self._periodic(self.xyz, distance)

    def heading_at(self, distance: float | np.ndarray) -> np.ndarray:
        """The road's heading in radians, unwrapped over laps."""
        turns = 2 * np.pi * np.round((self.heading[-1] - self.heading[0]) / (2 * np.pi))
        laps, rest = np.divmod(distance, self.length)
        wrapped = np.append(self.heading, self.heading[0] + turns)
        return np.interp(rest, np.append(self.distance, self.length), wrapped) + laps * turns

    def curvature_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Curvature in 1/m, left bends positive."""
        return self._periodic(self.curvature, distance)

    def grade_at(self, distance: float | np.ndarray) -> np.ndarray:
        """Rise per metre, climbing positive."""
        return self._periodic(self.grade, distance)

    def stretch_at(self, distance: float) -> Stretch | None:
        """The stretch that covers a distance, or None where the road is as usual."""
        rest = distance % self.length
        return next((one for one in self.stretches if one.start <= rest < one.end), None)

    def verge_at(self, distance: float) -> Verge:
        """What lies left and right of the road there."""
        stretch = self.stretch_at(distance)
        return stretch.verge if stretch else self.verge

    def locate(self, x: float, y: float, near: float | None = None) -> Place:
        """The place of a point; `near`, its distance a moment ago, searches 20 m around it."""
        count = len(self.distance)
        if near is None:
            candidates = np.arange(count)
        else:
            reach = int(20 / STEP_M)
            middle = round(near / STEP_M)
            candidates = np.arange(middle - reach, middle + reach + 1) % count
        away = self.xyz[candidates, :2] - (x, y)
        nearest = int(candidates[np.argmin((away**2).sum(1))])
        along = np.array([np.cos(self.heading[nearest]), np.sin(self.heading[nearest])])
        to_point = np.array([x, y]) - self.xyz[nearest, :2]
        distance = float(self.distance[nearest] + np.clip(to_point @ along, -STEP_M, STEP_M))
        distance %= self.length
        on_road = self.at(distance)
        heading = float(self.heading_at(distance))
        right = np.array([np.sin(heading), -np.cos(heading)])
        return Place(
            distance=distance,
            cte=float((np.array([x, y]) - on_road[:2]) @ right),
            heading=heading,
            curvature=float(self.curvature_at(distance)),
            grade=float(self.grade_at(distance)),
            z=float(on_road[2]),
        )

    def _periodic(self, values: np.ndarray, distance: float | np.ndarray) -> np.ndarray:
        # Quicker than np.interp with a period, which sorts all samples at each call.
        count = len(values)
        position = np.asarray(distance) % self.length * (count / self.length)
        index = position.astype(int)
        part = position - index
        if values.ndim > 1:
            part = part[..., None]
        return values[index % count] * (1 - part) + values[(index + 1) % count] * part


def make_centreline(points: np.ndarray) -> dict[str, np.ndarray | float]:
    """The closed smooth curve through control points float64 [N, 3], as `Track`'s arrays."""
    closed = np.vstack([points, points[:1]])
    # Centripetal parameters: no loops or cusps between points at uneven distances.
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
