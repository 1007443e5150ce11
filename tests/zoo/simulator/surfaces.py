"""Heights of meshes at places, for tests."""

from collections.abc import Sequence

import numpy as np

from zoo.simulator.scenery.mesh import Mesh

CELL_M = 4.0


def surfaces_at(meshes: Sequence[Mesh], xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return all surfaces that cover places float [N, 2]: the places' numbers, and the heights."""
    triangles = np.concatenate([mesh.points[mesh.triangles] for mesh in meshes])
    low = np.floor(triangles[..., :2].min(1) / CELL_M).astype(int)
    high = np.floor(triangles[..., :2].max(1) / CELL_M).astype(int)
    first = low.min(0)
    columns = int(high[:, 0].max()) - first[0] + 1
    listed, cells = [], []
    for east in range((high - low)[:, 0].max() + 1):
        for north in range((high - low)[:, 1].max() + 1):
            here = np.flatnonzero((low + (east, north) <= high).all(1))
            place = low[here] + (east, north) - first
            listed.append(here)
            cells.append(place[:, 1] * columns + place[:, 0])
    listed, cells = np.concatenate(listed), np.concatenate(cells)
    order = np.argsort(cells, kind="stable")
    listed, cells = listed[order], cells[order]
    place = np.floor(xy / CELL_M).astype(int) - first
    wanted = place[:, 1] * columns + place[:, 0]
    start, end = np.searchsorted(cells, wanted), np.searchsorted(cells, wanted, "right")
    number = np.repeat(np.arange(len(xy)), end - start)
    offset = np.arange(len(number)) - np.repeat(np.cumsum(end - start) - (end - start), end - start)
    a, b, c = triangles[listed[start[number] + offset]].transpose(1, 0, 2)
    ab, ac, ap = b - a, c - a, xy[number] - a[:, :2]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    flat = np.abs(area) > 1e-9
    area = np.where(flat, area, 1.0)
    to_b = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / area
    to_c = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / area
    inside = flat & (to_b >= -1e-6) & (to_c >= -1e-6) & (to_b + to_c <= 1 + 1e-6)
    height = a[:, 2] + to_b * ab[:, 2] + to_c * ac[:, 2]
    return number[inside], height[inside]
