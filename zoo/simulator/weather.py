"""Light and weather: conditions that change frames but not the road."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from zoo.base.command_keys import Section, keys_of, typed_keys
from zoo.base.errors import UsageError, placed_errors
from zoo.base.key_values import check_keys, check_values, constructed
from zoo.base.plain_files import parse_yaml
from zoo.simulator.udacity_car import CameraOffset

if TYPE_CHECKING:
    from zoo.simulator.track import Surroundings  # slow import: SciPy

SUN_DEG, SUN, BRIGHTNESS = (5, 90), (0, 3), (0.05, 4)

Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class Weather:
    """Conditions of light, air, cameras and lens.

    Args:
        sun_azimuth_deg: direction of the sun, degrees counter-clockwise from east.
        sun_elevation_deg: height of the sun, degrees above the horizon, 5..90.
        sun: strength of the sun's light, 0..3; 1 is a clear day.
        brightness: factor on the whole frame, 0.05..4.
        fog: density of fog, 0 (none)..1 (visibility of about 20 m).
        rain: amount of rain streaks in the frame, 0..1.
        wet: darkness of a wet road, 0..1.
        shadows: whether trees and rocks cast shadows on the road.
        texture_seed: random seed of the grain of road and ground.
        camera: displacement of the cameras.
        noise: standard deviation of the sensor's noise, 0..100 of 255 grey levels.
        blur: standard deviation of the lens's blur in pixels, 0 (sharp)..20.
    """

    sun_azimuth_deg: float = 210.0
    sun_elevation_deg: Annotated[float, Field(ge=SUN_DEG[0], le=SUN_DEG[1])] = 42.0
    sun: Annotated[float, Field(ge=SUN[0], le=SUN[1])] = 1.0
    brightness: Annotated[float, Field(ge=BRIGHTNESS[0], le=BRIGHTNESS[1])] = 1.0
    fog: Share = 0.0
    rain: Share = 0.0
    wet: Share = 0.0
    shadows: bool = True
    texture_seed: Annotated[int, Field(ge=0)] = 1
    camera: Annotated[CameraOffset, Section()] = field(default_factory=CameraOffset)
    noise: Annotated[float, Field(ge=0, le=100)] = 0.0
    blur: Annotated[float, Field(ge=0, le=20)] = 0.0

    def __post_init__(self) -> None:
        check_values(self)


CLEAR = Weather()


def lit_by(surroundings: "Surroundings", weather: Weather) -> Weather:
    """Return a weather in the light of a track's surroundings, within the ranges of a weather."""
    lifted_deg = weather.sun_elevation_deg + surroundings.sun_lift_deg
    return replace(
        weather,
        sun_azimuth_deg=weather.sun_azimuth_deg + surroundings.sun_turn_deg,
        sun_elevation_deg=float(np.clip(lifted_deg, *SUN_DEG)),
        sun=float(np.clip(weather.sun * surroundings.sun, *SUN)),
        brightness=float(np.clip(weather.brightness * surroundings.brightness, *BRIGHTNESS)),
    )


def random_weather(rng: np.random.Generator) -> Weather:
    """Draw a random day: any sun, sometimes fog, rain or a wet road."""
    return Weather(
        sun_azimuth_deg=rng.uniform(0, 360),
        sun_elevation_deg=rng.uniform(20, 80),
        sun=rng.uniform(0.6, 1.2),
        brightness=rng.uniform(0.7, 1.2),
        fog=rng.uniform(0, 0.5) if rng.random() < 0.3 else 0.0,
        rain=rng.uniform(0.2, 0.8) if rng.random() < 0.2 else 0.0,
        wet=rng.uniform(0.3, 1) if rng.random() < 0.3 else 0.0,
        shadows=bool(rng.random() < 0.8),
        texture_seed=int(rng.integers(1, 2**31)),
        camera=CameraOffset(
            right_m=rng.normal(0, 0.05),
            up_m=rng.normal(0, 0.02),
            pitch_deg=rng.normal(0, 0.4),
            yaw_deg=rng.normal(0, 0.4),
            roll_deg=rng.normal(0, 0.4),
        ),
        noise=rng.uniform(0, 6),
    )


def read_weather(weather: str | Mapping[str, Any] | Weather) -> Weather | str:
    """Parse a user's weather: `clear`, `random`, or settings that differ from a clear day.

    Settings are text or a dict. `random` and a `Weather` are returned unchanged.

    >>> read_weather("{fog: 0.4, wet: 1, camera: {pitch_deg: 2}}").camera.pitch_deg
    2.0
    >>> read_weather({"fog": 0.4}).fog
    0.4

    Raises:
        UsageError: the weather is none of these, or a setting or its value is wrong.
    """
    if weather == "random" or isinstance(weather, Weather):
        return weather
    if weather == "clear":
        return CLEAR
    settings: object = weather
    if isinstance(weather, str):
        with suppress(ValueError):
            settings = parse_yaml(weather)
    if not isinstance(settings, Mapping):
        raise UsageError(f"weather={weather}: must be clear, random or settings, {{fog: 0.4}}")
    with placed_errors("weather"):
        values = dict(typed_keys(settings))
        check_keys(values, keys_of(Weather))
        return Weather(**constructed(Weather, values))
