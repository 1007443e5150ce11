"""The ground around the road: heights, mesh and lakes."""

from dataclasses import replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from zoo.simulator.scenery.mesh import Mesh, grid_mesh
from zoo.simulator.scenery.textures import untextured
from zoo.simulator.scenery.verges import GRASS, ROCK, SAND, SOILS, smooth, verge_room
from zoo.simulator.track import Track

CELL_M = 8.0
# Of a coarse ground: cells along the edge of a square, and its distance from the road.
LARGE = ((4, 60.0), (2, 18.0), (1, -np.inf))
MARGIN_M = 190.0  # width of the ground around the track
RIM_M = 90.0  # width of its outer part, which rises to mountains that close the view
RIM_HEIGHT_M = 42.0
SINK_M = 0.5  # depth below the verges, which lie on it
BELOW_M, BESIDE_M = 0.3, 1.5  # the ground lies this much below the road, up to this far beside it
CHUNK = 20_000  # places at a time, to bound the memory
STEEP = 1.6  # of mounds; above 1 their tops are flat
BLEND_M, MOST_NEAR = 2.0, 96  # samples' distance, and their number, for heights between roads
PALE_ROCK, WATER = (0.62, 0.59, 0.50), (0.46, 0.56, 0.74)
PATCHES = {
    "sand": GRASS,
    "grass": SAND,
    "forest": (0.46, 0.44, 0.24),
    "autumn": (0.44, 0.29, 0.11),
}
CLIFFS = {"sand": PALE_ROCK, "grass": PALE_ROCK, "forest": ROCK, "autumn": (0.20, 0.15, 0.11)}
GREY, GREY_M = (0.30, 0.30, 0.31), (45.0, 70.0)  # autumn's far ground, from and over these metres


class Ground:
    """The ground around a track, drawn from the seed of its surroundings.

    Args:
        track: track whose ground to build.
        coarse: whether larger squares are level away from the road, and drawn as one.
    """

    def __init__(self, track: Track, coarse: bool = False) -> None:
        self.track, self.coarse = track, coarse
        self.around = track.surroundings
        self.near_road = cKDTree(track.xyz[:, :2])
        self.room = verge_room(track)
        # The ground has the height of the road below a bridge.
        self.standing = np.flatnonzero(~track.bridge)
        self.near_standing = cKDTree(track.xyz[self.standing, :2])
        self.low = track.xyz[:, :2].min(0) - MARGIN_M
        self.high = track.xyz[:, :2].max(0) + MARGIN_M
        rng = np.random.default_rng(self.around.seed)
        self.waves = [rng.uniform(-1, 1, (64, 64)) for _ in range(4)]
        self.walled = track.verge_kinds[0] == "wall"
        self.dropping = self._sides("drop", "barriers")
        self.rocky = self._sides("rock", "cliff")

    def height(self, xy: np.ndarray) -> np.ndarray:
        """Return heights in metres, float [N], at x and y, float [N, 2]."""
        apart, nearest = self.near_standing.query(xy)
        nearest = self.standing[nearest]
        around = self.around
        away = xy - self.track.xyz[nearest, :2]
        side = ((away * self.track.rightwards[nearest]).sum(1) > 0).astype(int)
        rise = around.hills * self._hills(xy)
        rise = rise * smooth((apart - around.calm) / 45)
        # The verges extend to 14 m, and neither cells of the ground nor mounds may stick out.
        rise = rise + 6.0 * self.rocky[side, nearest] * smooth((apart - 13) / 8)
        rise = rise + self._mounds(xy) * smooth((apart - 13) / 8)
        rise = rise - 9.0 * self.dropping[side, nearest] * smooth((apart - 5) / 12)
        # The ground has the road's height near it, and the track's mean height far away.
        level = self.track.xyz[:, 2]
        weight = smooth((apart - 60) / 120)
        nearby = level[nearest] if self.room is None else self._level_between(xy)
        base = nearby * (1 - weight) + level.mean() * weight - SINK_M
        edge = np.minimum(xy - self.low, self.high - xy).min(1)
        rim = RIM_HEIGHT_M * smooth((RIM_M - edge) / RIM_M)
        rim = rim * (0.55 + 0.45 * self._noise(xy, 55, 3))
        return self._flood(xy, base + rise + rim, apart, nearest)

    def mesh_height(self, xy: np.ndarray) -> np.ndarray:
        """Return the mesh's heights in metres, float [N], at x and y, float [N, 2]."""
        corners, weights = self._corners(xy)
        return (self.grid[2].reshape(-1)[corners] * weights).sum(1)

    def density(self, xy: np.ndarray) -> np.ndarray:
        """Return the density of plants, about 0..1, at x and y, float [N, 2]."""
        return self._noise(xy, 40, 2)

    def in_water(self, xy: np.ndarray) -> np.ndarray:
        """Return bool [N]: whether points lie in a lake or on the 4 m of its shore."""
        wet = np.zeros(len(xy), bool)
        for x, y, radius in self.around.lakes:
            wet |= np.hypot(*(xy - (x, y)).T) < radius + 4
        return wet

    def meshes(self) -> list[Mesh]:
        """Return the ground's mesh, and a level one for each lake."""
        x, y, z = self.grid
        xy = np.stack(np.meshgrid(x, y), -1)
        flat = xy.reshape(-1, 2)
        down_y, down_x = np.gradient(z, CELL_M)
        normals = np.stack([-down_x, -down_y, np.ones_like(z)], -1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        colours = self._colours(flat, normals[..., 2].reshape(-1)).reshape(*z.shape, 3)
        points = np.concatenate([xy, z[..., None]], -1)
        material = "leaves" if self.around.ground == "autumn" else "ground"
        ground = grid_mesh(material, points, normals, colours, xy / 9.0)
        lakes = [self._lake(*lake) for lake in self.around.lakes]
        if self.coarse:
            number = np.arange(z.size).reshape(z.shape)
            far, *near = (
                np.stack([a, number[i, j + step], b, a, b, number[i + step, j]], -1).reshape(-1, 3)
                for step, i, j in self._squares
                for a, b in [(number[i, j], number[i + step, j + step])]
            )
            lakes = [untextured(replace(ground, triangles=far)), *lakes]
            ground = replace(ground, triangles=np.concatenate(near))
        return [ground, *lakes]

    @cached_property
    def grid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x [X], y [Y] and heights [Y, X] of the mesh, which nowhere covers the road."""
        x, y = self._axes()
        z = self.height(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
        road, least = self._road_points()
        corners, weights = self._corners(road, len(x))
        for _ in range(100):
            over = (z[corners] * weights).sum(1) - least
            covered = over > 1e-6
            if not covered.any():
                break
            # The smallest change of a triangle's corners that lowers it below the point.
            share = weights[covered] / (weights[covered] ** 2).sum(1, keepdims=True)
            lower = np.zeros_like(z)
            np.maximum.at(lower, corners[covered], over[covered, None] * share)
            z = z - lower
        z = z.reshape(len(y), len(x))
        if self.coarse:
            self._flatten(z)
        return x, y, z

    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        low, high = self.low, self.high + CELL_M
        return np.arange(low[0], high[0], CELL_M), np.arange(low[1], high[1], CELL_M)

    def _flatten(self, z: np.ndarray) -> None:
        """Move the heights [Y, X] within large squares to the two triangles of their corners."""
        for step, i, j in self._squares:
            a, b, c, d = z[i, j], z[i, j + step], z[i + step, j + step], z[i + step, j]
            for v, u in product(range(step + 1), repeat=2):
                nearer = a + u / step * (b - a) + v / step * (c - b)
                z[i + v, j + u] = nearer if u >= v else a + v / step * (d - a) + u / step * (c - d)

    @cached_property
    def _squares(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Return the squares' cells along an edge, and the rows and columns of their corners."""
        x, y = self._axes()
        apart = self.near_road.query(np.stack(np.meshgrid(x, y), -1))[0]
        free, squares = np.ones(apart.shape, bool), []
        for step, away in LARGE:
            i, j = np.mgrid[0 : len(y) - step : step, 0 : len(x) - step : step]
            far = free[i, j] & (apart[i + step // 2, j + step // 2] > away + 0.71 * step * CELL_M)
            for v, u in product(range(step), repeat=2):
                free[i[far] + v, j[far] + u] = False
            squares.append((step, i[far], j[far]))
        return squares

    def _corners(self, xy: np.ndarray, columns: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners int [N, 3] of the mesh's triangles at points, and their weights."""
        columns = len(self.grid[0]) if columns is None else columns
        place = (xy - self.low) / CELL_M
        cell = place.astype(int)
        right, up = (place - cell).T
        first = cell[:, 1] * columns + cell[:, 0]
        beside = np.where(right >= up, first + 1, first + columns)
        corners = np.stack([first, beside, first + columns + 1], -1)
        least, most = np.minimum(right, up), np.maximum(right, up)
        return corners, np.stack([1 - most, most - least, least], -1)

    def _road_points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return points float [N, 2] on the road and beside it, and the highest ground there."""
        track = self.track
        half = track.widths / 2 + BESIDE_M
        lateral = np.linspace(-half, half, 9, axis=-1)
        points = track.xyz[:, None, :2] + lateral[..., None] * track.rightwards[:, None]
        return points.reshape(-1, 2), np.repeat(track.xyz[:, 2] - BELOW_M, 9)

    def _level_between(self, xy: np.ndarray) -> np.ndarray:
        """Return heights float [N] that change smoothly from one part of the road to the next."""
        track = self.track
        stride = round(BLEND_M * len(track.distance) / track.length)
        samples = self.standing[::stride]
        near_road, height = cKDTree(track.xyz[samples, :2]), track.xyz[samples, 2]
        level = np.empty(len(xy))
        for first in range(0, len(xy), CHUNK):
            part = slice(first, first + CHUNK)
            apart, near = near_road.query(xy[part], min(MOST_NEAR, len(samples)))
            weight = 1 / (apart**2 + 0.5) ** 2
            level[part] = (weight * height[near]).sum(1) / weight.sum(1)
        return level

    def _colours(self, xy: np.ndarray, upright: np.ndarray) -> np.ndarray:
        """Return colours: the ground's soil, patches of another one, rock on steep slopes."""
        patch = smooth(self._noise(xy, 34, 2) * 2.5 - 0.75)[:, None]
        ground = self.around.ground
        colours = np.array(SOILS[ground]) * (1 - patch) + np.array(PATCHES[ground]) * patch
        steep = smooth((0.985 - upright) / 0.06)[:, None]
        colours = colours * (1 - steep) + np.array(CLIFFS[ground]) * steep
        if ground == "autumn":
            first, length = GREY_M
            far = smooth((self.near_road.query(xy)[0] - first) / length)[:, None]
            colours = colours * (1 - far) + np.array(GREY) * far
        return colours

    def _hills(self, xy: np.ndarray) -> np.ndarray:
        size = self.around.hill_size
        hills = 0.65 * self._noise(xy, size, 0) + 0.35 * self._noise(xy, size / 2.7, 1)
        return np.clip(hills * 1.5 - 0.35, -0.05, 1)

    def _mounds(self, xy: np.ndarray) -> np.ndarray:
        """Return the heights of the track's own mounds."""
        rise = np.zeros(len(xy))
        for x, y, radius, height in self.around.mounds:
            inside = 1 - np.hypot(*(xy - (x, y)).T) / radius
            rise = np.maximum(rise, height * smooth(inside * STEEP))
        return rise

    def _noise(self, xy: np.ndarray, size: float, number: int) -> np.ndarray:
        """Return smooth noise, about 0..1, that varies over `size` metres."""
        at = ((xy - self.low) / size).T
        return 0.5 + 0.5 * map_coordinates(self.waves[number], at, order=3, mode="grid-wrap")

    def _sides(self, *kinds: str) -> np.ndarray:
        """Return float [2, N]: 1 where the left or right verge is of a kind, blended over 8 m."""
        is_kind = np.isin(self.track.verge_kinds, kinds).astype(float)
        window = np.ones(17) / 17
        wrapped = np.pad(is_kind, ((0, 0), (8, 8)), mode="wrap" if self.track.closed else "edge")
        return np.stack([np.convolve(row, window, "valid") for row in wrapped])

    def _flood(
        self, xy: np.ndarray, height: np.ndarray, apart: np.ndarray, nearest: np.ndarray
    ) -> np.ndarray:
        """Lower the ground in lakes, but not below the road, except under bridges."""
        dam = np.where(self.walled[nearest], 0.0, 1 - smooth((apart - 11) / 9))
        bottom = self.around.water_level - 1.5
        for x, y, radius in self.around.lakes:
            wet = smooth((radius - np.hypot(*(xy - (x, y)).T)) / 14) * (1 - dam)
            height = height * (1 - wet) + np.minimum(height, bottom) * wet
        return height

    def _lake(self, x: float, y: float, radius: float) -> Mesh:
        step = 16.0
        line = np.arange(-radius - step, radius + 2 * step, step)
        xy = np.stack(np.meshgrid(x + line, y + line), -1)
        if self.coarse:  # a disc, so that less water lies below the ground
            turn, away = np.linspace(0, 2 * np.pi, 17)[:, None], np.array([0.0, radius])
            xy = (x, y) + away[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
        points = np.concatenate([xy, np.full((*xy.shape[:2], 1), self.around.water_level)], -1)
        return grid_mesh("concrete", points, (0.0, 0.0, 1.0), WATER, xy / 24.0)
