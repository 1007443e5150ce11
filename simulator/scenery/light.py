"""Sunlight on meshes: what colour each point has in a weather."""

import numpy as np

from simulator.scenery.mesh import Mesh
from simulator.scenery.textures import MEANS
from simulator.weather import Weather

# Read off the original's pictures: its concrete is 255, 253, 226 in the sun, 125, 138, 145 beside.
SUN_RGB = np.array([1.08, 1.00, 0.66])
SKY_RGB = np.array([0.50, 0.57, 0.61])


def towards_sun(weather: Weather) -> np.ndarray:
    """The unit vector float64 [3] that points at the sun."""
    azimuth, elevation = np.radians([weather.sun_azimuth_deg, weather.sun_elevation_deg])
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def lit_colours(mesh: Mesh, weather: Weather, shade: np.ndarray | None) -> np.ndarray:
    """Colours uint8 [N, 3] of a mesh's points, by Lambert's law and a blue light from the sky.

    `shade` float [N] is the share of the sun that reaches each point; None for all of it.
    """
    if mesh.material == "sky":
        return _to_bytes(mesh.colours * (0.5 + 0.5 * weather.sun))
    facing = np.clip(mesh.normals @ towards_sun(weather), 0, 1)
    if shade is not None:
        facing = facing * shade
    light = SKY_RGB + weather.sun * facing[:, None] * SUN_RGB
    if mesh.material == "plants":
        return _to_bytes(mesh.colours * light)
    wet = 1 - 0.45 * weather.wet if mesh.material in ("asphalt", "cobbles", "plain") else 1.0
    return _to_bytes(mesh.colours * light * wet / MEANS.get(mesh.material, 1.0))


def _to_bytes(colours: np.ndarray) -> np.ndarray:
    return (np.clip(colours, 0, 1) * 255).astype(np.uint8)
