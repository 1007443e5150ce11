"""Sunlight on meshes: the colour of each point in a weather."""

import numpy as np

from simulator.scenery.mesh import Mesh
from simulator.scenery.textures import MEANS
from simulator.weather import Weather

# From the original's images: its concrete is 255, 253, 226 in the sun, 125, 138, 145 in shade.
SUN_RGB = np.array([1.08, 1.00, 0.66])
SKY_RGB = np.array([0.50, 0.57, 0.61])


def towards_sun(weather: Weather) -> np.ndarray:
    """Return the unit vector float64 [3] towards the sun."""
    azimuth, elevation = np.radians([weather.sun_azimuth_deg, weather.sun_elevation_deg])
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def lit_colours(mesh: Mesh, weather: Weather, shade: np.ndarray | None) -> np.ndarray:
    """Return colours uint8 [N, 3] of a mesh's points, by Lambert's law and blue light of the sky.

    Args:
        mesh: mesh to light.
        weather: weather with the sun's position and strength.
        shade: share of sunlight that reaches each point, float [N]; None for no shadows.
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
