"""Heights of meshes at places, for tests."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from zoo.simulator.scenery.mesh import Mesh


def surfaces_at(meshes: Sequence[Mesh], xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all surfaces that cover places float [N, 2]: the places' numbers, and the heights."""
    triangles = np.concatenate([mesh.points[mesh.triangles] for mesh in meshes])
    centres = triangles[..., :2].mean(1)
    reach = np.linalg.norm(triangles[..., :2] - centres[:, None], axis=-1).max(1)
    near = cKDTree(xy).query_ball_point(centres, reach + 1e-6)
    number = np.concatenate(near).astype(int)
    a, b, c = np.repeat(triangles, [len(places) for places in near], axis=0).transpose(1, 0, 2)
    ab, ac, ap = b - a, c - a, xy[number] - a[:, :2]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    flat = np.abs(area) > 1e-9
    area = np.where(flat, area, 1.0)
    to_b = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / area
    to_c = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / area
    inside = flat & (to_b >= -1e-6) & (to_c >= -1e-6) & (to_b + to_c <= 1 + 1e-6)
    height = a[:, 2] + to_b * ab[:, 2] + to_c * ac[:, 2]
    return number[inside], height[inside]
