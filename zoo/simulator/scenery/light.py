"""The sky, sunlight on meshes, and shadows of trees and rock faces on the road."""

import numpy as np
from scipy.spatial import cKDTree

from zoo.simulator.scenery.edges import DECK_M, WALL_END_M
from zoo.simulator.scenery.mesh import Mesh, grid_mesh
from zoo.simulator.scenery.plants import Standing
from zoo.simulator.scenery.textures import MEANS, PAVED
from zoo.simulator.track import Track
from zoo.simulator.weather import Weather

# From the original's images: its concrete is 255, 253, 226 in the sun, 125, 138, 145 in shade.
SUN_RGB = np.array([1.08, 1.00, 0.66])
SKY_RGB = np.array([0.50, 0.57, 0.61])
REACH_M = 45.0  # trees farther from the road cast no shadow on it
LONGEST_M = 40.0  # longest shadow of a low sun
CROWN = {"pine": (0.2, 1.0), "tall_pine": (0.45, 1.0), "round_tree": (0.25, 1.0)}
CROWN |= {"red_tree": (0.25, 1.0), "brown_tree": (0.25, 1.0)}
ROCK_TOP_M, ROCK_FOOT_M = 4.2, 2.2  # its height, and its distance from the road's edge
RADIUS_M = 800.0
# Elevation in degrees, and RGB 0..255 of the original's sky there (rows 0 to 57 of its images).
COLOURS = (
    (-90, (176, 200, 208)),
    (0, (176, 202, 212)),
    (3, (164, 194, 214)),
    (6, (152, 182, 214)),
    (10, (140, 171, 209)),
    (14, (125, 154, 195)),
    (18, (114, 141, 184)),
    (21, (104, 131, 175)),
    (40, (92, 118, 166)),
    (90, (80, 105, 155)),
)


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
    wet = 1 - 0.45 * weather.wet if mesh.material in PAVED else 1.0
    return _to_bytes(mesh.colours * light * wet / MEANS.get(mesh.material, 1.0))


def _to_bytes(colours: np.ndarray) -> np.ndarray:
    return (np.clip(colours, 0, 1) * 255).astype(np.uint8)


class Shadows:
    """The sunlight that reaches points of the road, as a function of the weather.

    Args:
        track: track of the road.
        standing: objects that may cast shadows.
        pieces: points float [N, 3] of each piece of the road's mesh.
    """

    def __init__(self, track: Track, standing: list[Standing], pieces: list[np.ndarray]) -> None:
        self.ends = np.cumsum([len(points) for points in pieces])[:-1]
        self.points = np.concatenate(pieces)
        self.nearby = cKDTree(self.points[:, :2])
        middle = cKDTree(track.xyz[:, :2])
        trees = [plant for plant in standing if plant.kind in CROWN]
        apart = middle.query(np.array([tree.foot[:2] for tree in trees]).reshape(-1, 2))[0]
        self.trees = [tree for tree, away in zip(trees, apart, strict=True) if away < REACH_M]
        _, nearest = middle.query(self.points[:, :2])
        self.right = track.rightwards[nearest]
        self.cte = ((self.points - track.xyz[nearest])[:, :2] * self.right).sum(1)
        rocky = np.isin(track.verge_kinds, ("rock", "cliff"))
        self.rock_left, self.rock_right = rocky[:, nearest]
        self.edge = track.widths[nearest] / 2
        deck = track.xyz[track.bridge]
        self.deck = (cKDTree(deck[:, :2]), deck[:, 2]) if len(deck) else None
        self.deck_half = float(track.widths.max() / 2 + WALL_END_M)

    def __call__(self, weather: Weather) -> list[np.ndarray]:
        """Return for each piece float [N]: the share of sunlight, 0..1, that reaches its points."""
        sun = towards_sun(weather)
        light = np.ones(len(self.points))
        for tree in self.trees:
            self._cast(light, tree, sun)
        light[self._behind_rock(sun)] = 0.0
        light[self._below_bridge(sun)] = 0.0
        return np.split(light, self.ends)

    def _cast(self, light: np.ndarray, tree: Standing, sun: np.ndarray) -> None:
        """Darken the ellipse in a tree's shadow."""
        low, high = (share * tree.height for share in CROWN[tree.kind])
        away = -sun[:2] / sun[2]
        length = np.hypot(*away)
        if low * length > LONGEST_M:
            return
        middle = tree.foot[:2] + away * (low + high) / 2
        long = max((high - low) / 2 * length, tree.width / 2)
        wide = tree.width / 2
        near = self.nearby.query_ball_point(middle, max(long, wide) * 1.3)
        if not near:
            return
        ahead = away / max(length, 1e-6)
        offset = self.points[near, :2] - middle
        along, across = offset @ ahead, offset @ (-ahead[1], ahead[0])
        inside = np.hypot(along / long, across / wide)
        # Leaves transmit some light, and the border is soft.
        light[near] = np.minimum(light[near], np.clip((inside - 0.7) / 0.5, 0.15, 1))

    def _behind_rock(self, sun: np.ndarray) -> np.ndarray:
        """Return bool [N]: whether a rock face stands between a point and the sun."""
        rightwards = self.right @ (sun[:2] / np.hypot(*sun[:2]))
        wall = self.edge + ROCK_FOOT_M
        apart = np.where(rightwards > 0, wall - self.cte, wall + self.cte)
        away = apart / np.maximum(np.abs(rightwards), 1e-3)
        rocky = np.where(rightwards > 0, self.rock_right, self.rock_left)
        return rocky & (apart > 0) & (away * sun[2] / np.hypot(*sun[:2]) < ROCK_TOP_M)

    def _below_bridge(self, sun: np.ndarray) -> np.ndarray:
        """Return bool [N]: whether a bridge stands between a point and the sun."""
        if self.deck is None:
            return np.zeros(len(self.points), bool)
        tree, height = self.deck
        _, near = tree.query(self.points[:, :2])
        rise = height[near] - DECK_M - self.points[:, 2]
        # A ray to the sun meets the deck where it has the deck's height.
        apart, _ = tree.query(self.points[:, :2] + rise[:, None] * sun[:2] / sun[2])
        return (rise > 0.5) & (apart < self.deck_half)


def sky_mesh(coarse: bool, tint: tuple[float, float, float]) -> Mesh:
    """Return a dome around the camera; its colours, times a tint, are not shaded."""
    elevation = np.array([colour[0] for colour in COLOURS], float)
    colours = np.array([colour[1] for colour in COLOURS], float) / 255 * tint
    steps = np.unique(np.concatenate([elevation, np.arange(-10, 30, 2), np.arange(30, 91, 15)]))
    steps = np.r_[-10, elevation[1:]] if coarse else steps
    around = np.linspace(0, 2 * np.pi, 9 if coarse else 17)
    up, turn = np.meshgrid(np.radians(steps), around, indexing="ij")
    unit = np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)
    points = RADIUS_M * np.stack(unit, -1)
    by_step = np.stack([np.interp(steps, elevation, colours[:, c]) for c in range(3)], -1)
    return grid_mesh("sky", points, (0.0, 0.0, 1.0), by_step[:, None], np.zeros(2))
