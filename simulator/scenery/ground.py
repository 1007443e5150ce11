"""The ground around the road: heights, mesh and lakes."""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from simulator.scenery.mesh import Mesh, grid_triangles
from simulator.scenery.road import FOREST, GRASS, ROCK, SAND
from simulator.track import Track

CELL_M = 8.0
MARGIN_M = 190.0  # width of the ground around the track
RIM_M = 90.0  # width of its outer part, which rises to mountains that close the view
RIM_HEIGHT_M = 42.0
SINK_M = 0.5  # depth below the verges, which lie on it
PALE_ROCK, WATER = (0.62, 0.59, 0.50), (0.46, 0.56, 0.74)


class Ground:
    """The ground around a track, drawn from the seed of its surroundings."""

    def __init__(self, track: Track) -> None:
        self.track = track
        self.around = track.surroundings
        self.near_road = cKDTree(track.xyz[:, :2])
        self.low = track.xyz[:, :2].min(0) - MARGIN_M
        self.high = track.xyz[:, :2].max(0) + MARGIN_M
        rng = np.random.default_rng(self.around.seed)
        self.waves = [rng.uniform(-1, 1, (64, 64)) for _ in range(4)]
        walled = [track.verge_at(float(d)).left == "wall" for d in track.distance]
        self.walled = np.array(walled)
        self.dropping = self._sides("drop")
        self.rocky = self._sides("rock")

    def height(self, xy: np.ndarray) -> np.ndarray:
        """Return heights in metres, float [N], at x and y, float [N, 2]."""
        apart, nearest = self.near_road.query(xy)
        around = self.around
        heading = self.track.heading[nearest]
        away = xy - self.track.xyz[nearest, :2]
        side = (away[:, 0] * np.sin(heading) - away[:, 1] * np.cos(heading) > 0).astype(int)
        rise = around.hills * self._hills(xy)
        rise = rise * _smooth((apart - around.calm) / 45)
        # The verges extend to 14 m, and no cell of the ground may stick out through them.
        rise = rise + 6.0 * self.rocky[side, nearest] * _smooth((apart - 13) / 8)
        rise = rise - 9.0 * self.dropping[side, nearest] * _smooth((apart - 5) / 12)
        # The ground has the road's height near it, and the track's mean height far away.
        level = self.track.xyz[:, 2]
        weight = _smooth((apart - 60) / 120)
        base = level[nearest] * (1 - weight) + level.mean() * weight - SINK_M
        edge = np.minimum(xy - self.low, self.high - xy).min(1)
        rim = (
            RIM_HEIGHT_M * _smooth((RIM_M - edge) / RIM_M) * (0.55 + 0.45 * self._noise(xy, 55, 3))
        )
        return self._flood(xy, base + rise + rim, apart, nearest)

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
        x = np.arange(self.low[0], self.high[0] + CELL_M, CELL_M)
        y = np.arange(self.low[1], self.high[1] + CELL_M, CELL_M)
        xy = np.stack(np.meshgrid(x, y), -1)
        flat = xy.reshape(-1, 2)
        z = self.height(flat).reshape(xy.shape[:2])
        down_y, down_x = np.gradient(z, CELL_M)
        normals = np.stack([-down_x, -down_y, np.ones_like(z)], -1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        ground = Mesh(
            "ground",
            np.concatenate([xy, z[..., None]], -1).reshape(-1, 3),
            normals.reshape(-1, 3),
            self._colours(flat, normals[..., 2].reshape(-1)),
            flat / 9.0,
            grid_triangles(*z.shape),
        )
        return [ground, *(self._lake(*lake) for lake in self.around.lakes)]

    def _colours(self, xy: np.ndarray, upright: np.ndarray) -> np.ndarray:
        """Return colours: sand or forest soil, patches of grass, rock on steep slopes."""
        sandy = self.around.ground == "sand"
        patch = _smooth(self._noise(xy, 34, 2) * 2.5 - 0.75)[:, None]
        colours = np.array(SAND if sandy else FOREST) * (1 - patch)
        colours = colours + np.array(GRASS if sandy else (0.46, 0.44, 0.24)) * patch
        steep = _smooth((0.985 - upright) / 0.06)[:, None]
        return colours * (1 - steep) + np.array(PALE_ROCK if sandy else ROCK) * steep

    def _hills(self, xy: np.ndarray) -> np.ndarray:
        size = self.around.hill_size
        hills = 0.65 * self._noise(xy, size, 0) + 0.35 * self._noise(xy, size / 2.7, 1)
        return np.clip(hills * 1.5 - 0.35, -0.05, 1)

    def _noise(self, xy: np.ndarray, size: float, number: int) -> np.ndarray:
        """Return smooth noise, about 0..1, that varies over `size` metres."""
        at = ((xy - self.low) / size).T
        return 0.5 + 0.5 * map_coordinates(self.waves[number], at, order=3, mode="grid-wrap")

    def _sides(self, kind: str) -> np.ndarray:
        """Return float [2, N]: 1 where the left or right verge is of a kind, blended over 8 m."""
        verges = [self.track.verge_at(float(d)) for d in self.track.distance]
        is_kind = np.array([[v.left == kind for v in verges], [v.right == kind for v in verges]])
        window = np.ones(17) / 17
        wrapped = np.pad(is_kind.astype(float), ((0, 0), (8, 8)), mode="wrap")
        return np.stack([np.convolve(row, window, "valid") for row in wrapped])

    def _flood(
        self, xy: np.ndarray, height: np.ndarray, apart: np.ndarray, nearest: np.ndarray
    ) -> np.ndarray:
        """Lower the ground in lakes, but not below the road, except under bridges."""
        dam = np.where(self.walled[nearest], 0.0, 1 - _smooth((apart - 11) / 9))
        bottom = self.around.water_level - 1.5
        for x, y, radius in self.around.lakes:
            wet = _smooth((radius - np.hypot(*(xy - (x, y)).T)) / 14) * (1 - dam)
            height = height * (1 - wet) + np.minimum(height, bottom) * wet
        return height

    def _lake(self, x: float, y: float, radius: float) -> Mesh:
        step = 16.0
        line = np.arange(-radius - step, radius + 2 * step, step)
        xy = np.stack(np.meshgrid(x + line, y + line), -1).reshape(-1, 2)
        count = len(xy)
        level = np.full((count, 1), self.around.water_level)
        return Mesh(
            "concrete",
            np.concatenate([xy, level], -1),
            np.tile([0.0, 0.0, 1.0], (count, 1)),
            np.tile(WATER, (count, 1)),
            xy / 24.0,
            grid_triangles(len(line), len(line)),
        )


def _smooth(x: np.ndarray) -> np.ndarray:
    """Return 0 below 0, 1 above 1, and a smooth step between (Perlin's smoothstep)."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)
