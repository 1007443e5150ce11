"""The roads and days that a search chooses from: a family's ranges, narrowed by parameters."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from zoo.base.command_keys import typed
from zoo.base.errors import InputError
from zoo.simulator.road_family import RoadFamily, draw_content
from zoo.simulator.track import Track
from zoo.simulator.weather import CLEAR, Weather, lit_by

SEEDS = 2**31  # seeds of roads are below it
WIDEST = 3.0  # largest radius of a road's bends, as a multiple of its smallest
# Smallest and largest value of each setting of a day. A value below 0 counts as 0, so that half of
# the days are without fog, rain, and so on.
DAYS = {
    "sun_elevation_deg": (15.0, 75.0),
    "brightness": (0.6, 1.4),
    "fog": (-0.6, 0.6),
    "rain": (-0.8, 0.8),
    "wet": (-1.0, 1.0),
    "noise": (-20.0, 20.0),
}
# By feature: the attribute of a weather, its label, and the range that the map covers.
DAY_FEATURES = {
    "sun": ("sun_elevation_deg", "sun's elevation, deg", (5.0, 90.0)),
    "brightness": ("brightness", "brightness, factor", (0.5, 1.5)),
    "fog": ("fog", "fog, 0..1", (0.0, DAYS["fog"][1])),
    "rain": ("rain", "rain, 0..1", (0.0, DAYS["rain"][1])),
    "wet": ("wet", "wetness, 0..1", (0.0, DAYS["wet"][1])),
    "noise": ("noise", "noise, sigma of 255", (0.0, DAYS["noise"][1])),
}


@dataclass(frozen=True)
class Parameter:
    """A number that a search chooses: its range, and whether its logarithm is uniform."""

    low: float
    high: float
    log: bool = False

    def at(self, share: float) -> float:
        """Return the value at a share of the range, 0..1.

        >>> round(Parameter(10, 1000, log=True).at(0.5), 6)
        100.0
        """
        share = min(max(share, 0.0), 1.0)
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + (self.high - self.low) * share

    def share(self, value: float) -> float:
        """Return the share of the range at which a value lies, 0..1; values outside are clipped."""
        if self.high == self.low:
            return 0.5
        ends = np.array([self.low, self.high, value], float)
        low, high, here = np.log(np.maximum(ends, 1e-9)) if self.log else ends
        return float(np.clip((here - low) / (high - low), 0, 1))


@dataclass(frozen=True)
class Feature:
    """A measured property of roads and days.

    Attributes:
        label: name with unit, for plots and tables.
        scale: range that the map covers.
    """

    label: str
    scale: Parameter


@dataclass(frozen=True, eq=False)
class Candidate:
    """A road with its day.

    Attributes:
        parameters: what the search chose; for a road of the whole family, what was measured.
        seed: seed of the road.
        content: content of the road's YAML file.
        track: the road.
        weather: its day.
        features: measured value of each feature, by its name.
    """

    parameters: dict[str, float]
    seed: int
    content: dict[str, Any]
    track: Track
    weather: Weather
    features: dict[str, float]


class SearchSpace:
    """Roads of a family with a day each.

    Args:
        family: family of roads; its ranges are the limits.
        length_m: length of each road.
        weather: the day of every drive; None to search days, too.
    """

    def __init__(self, family: RoadFamily, length_m: float, weather: Weather | None) -> None:
        self.weather = weather
        self.family = family.model_copy(update={"length": (length_m, length_m), "closed": 0.0})
        low, high = family.grade
        steepest, level = max(-low, high), max(low, -high, 0.0)
        self.parameters = {
            "radius": Parameter(*family.radius, log=True),
            "width": Parameter(*family.width),
            "grade": Parameter(level, steepest),
            "degrees": Parameter(*family.degrees),
        }
        self.features = {
            "bend": Feature("radius of the sharpest bend, m", self.parameters["radius"]),
            "width": Feature("smallest width, m", self.parameters["width"]),
            "grade": Feature("steepest grade, %", Parameter(100 * level, 100 * steepest)),
        }
        if weather is None:
            self.parameters |= {key: Parameter(*DAYS[key]) for key in DAYS}
            self.features |= {
                name: Feature(label, Parameter(*ends))
                for name, (_, label, ends) in DAY_FEATURES.items()
            }

    def draw(self, rng: np.random.Generator, parameters: dict[str, float]) -> Candidate | None:
        """Return a road within narrowed ranges, and its day; None if the car could take none.

        Without parameters of the road, it is drawn from the family's whole ranges; without those
        of a day, the day is clear.
        """
        family = self._narrowed(parameters) if "radius" in parameters else self.family
        seed = int(rng.integers(SEEDS))
        try:
            drawn, track = draw_content(family, seed)
        except InputError:
            return None
        content = json.loads(json.dumps(drawn))  # numpy's numbers do not fit into YAML
        weather = self._day(parameters)
        features = self._measure(track, weather)
        measured = {"radius": features["bend"], "width": features["width"]}
        measured |= {"grade": features["grade"] / 100, "degrees": self.parameters["degrees"].high}
        return Candidate(measured | parameters, seed, content, track, weather, features)

    def _narrowed(self, parameters: dict[str, float]) -> RoadFamily:
        family, sharpest, width = self.family, parameters["radius"], parameters["width"]
        low, high = family.grade
        ranges = {
            "radius": (sharpest, min(WIDEST * sharpest, family.radius[1])),
            "width": (width, min(width + family.widening, family.width[1])),
            "grade": (max(low, -parameters["grade"]), min(high, parameters["grade"])),
            "degrees": (family.degrees[0], parameters["degrees"]),
        }
        return family.model_copy(update=ranges)

    def _day(self, parameters: dict[str, float]) -> Weather:
        if self.weather is not None:
            return self.weather
        searched = sorted(DAYS.keys() & parameters.keys())
        day: dict[str, Any] = {key: round(max(parameters[key], 0.0), 3) for key in searched}
        return Weather(**day)

    def _measure(self, track: Track, weather: Weather) -> dict[str, float]:
        lit = lit_by(track.surroundings, weather)
        measured = {
            "bend": 1 / max(float(np.abs(track.curvature).max()), 1e-6),
            "width": float(track.widths.min()),
            "grade": 100 * float(np.abs(track.grade).max()),
        }
        measured |= {name: getattr(lit, key) for name, (key, *_) in DAY_FEATURES.items()}
        return {key: round(measured[key], 4) for key in self.features}


def weather_text(weather: Weather) -> str:
    """Return a weather as the option `weather=` takes it: what differs from a clear day.

    >>> weather_text(Weather(fog=0.4, wet=1.0)), weather_text(CLEAR)
    ('{fog: 0.4, wet: 1.0}', 'clear')
    """
    changed = _changed(weather, CLEAR)
    if changed.pop("camera", None):
        changed["camera"] = _changed(weather.camera, CLEAR.camera)
    return typed(changed) if changed else "clear"


def _changed(settings: object, usual: object) -> dict[str, Any]:
    return {k: value for k, value in vars(settings).items() if value != getattr(usual, k)}
