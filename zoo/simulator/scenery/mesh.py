"""Triangles as arrays, independent of any renderer."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Mesh:
    """Triangles of one material.

    Attributes:
        material: name of its texture in `zoo.simulator.scenery.textures`.
        points: float [N, 3], metres.
        normals: float [N, 3], unit length.
        colours: float [N, 3], reflectance of the surface in RGB, 0..1.
        uv: float [N, 2], texture coordinates; 0..1 spans the texture once.
        triangles: int [M, 3], indices of points; both sides are drawn.
        group: number of meshes of one place, of which a renderer draws those whose range has the
            distance from the camera to that place; None for a mesh that is always drawn.
        seen_m: that range in metres.
    """

    material: str
    points: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    uv: np.ndarray
    triangles: np.ndarray
    group: int | None = None
    seen_m: tuple[float, float] = (0.0, np.inf)

    @property
    def columns(self) -> tuple[np.ndarray, ...]:
        """Return the values of the points, in the order of the constructor."""
        return self.points, self.normals, self.colours, self.uv

    @classmethod
    def of_columns(
        cls, material: str, columns: Iterable[np.ndarray], triangles: np.ndarray
    ) -> "Mesh":
        """Return a mesh that is always drawn, from the values of its points."""
        points, normals, colours, uv = columns
        return cls(material, points, normals, colours, uv, triangles)


def grid_triangles(rows: int, columns: int) -> np.ndarray:
    """Return triangles int [2 * (rows-1) * (columns-1), 3] of a row-major grid of points."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)


def grid_mesh(
    material: str,
    points: np.ndarray,
    normals: np.ndarray | Sequence[float],
    colours: np.ndarray | Sequence[float],
    uv: np.ndarray,
) -> Mesh:
    """Return the mesh of a grid of points, float [R, C, 3]; the others broadcast to it."""

    def flat(values: np.ndarray | Sequence[float], size: int) -> np.ndarray:
        return np.array(np.broadcast_to(values, (*points.shape[:2], size))).reshape(-1, size)

    columns = flat(points, 3), flat(normals, 3), flat(colours, 3), flat(uv, 2)
    return Mesh(material, *columns, grid_triangles(*points.shape[:2]))


def thin(mesh: Mesh, columns: int, rows: np.ndarray, step: int) -> Mesh:
    """Return the mesh of some rows, and of every `step`-th column, of the mesh of a grid."""
    index = np.arange(len(mesh.points)).reshape(-1, columns)[rows][:, every(0, columns - 1, step)]
    values = (column[index.reshape(-1)] for column in mesh.columns)
    return Mesh.of_columns(mesh.material, values, grid_triangles(*index.shape))


def outward(mesh: Mesh) -> Mesh:
    """Return the mesh with counterclockwise triangles, seen from where its normals point."""
    a, b, c = mesh.points[mesh.triangles].transpose(1, 0, 2)
    turned = (np.cross(b - a, c - a) * mesh.normals[mesh.triangles].sum(1)).sum(1) < 0
    triangles = np.where(turned[:, None], mesh.triangles[:, ::-1], mesh.triangles)
    return replace(mesh, triangles=triangles)


def every(first: int, last: int, step: int) -> np.ndarray:
    """Return each `step`-th number from the first to the last, and the last."""
    return np.append(np.arange(first, last, step), last)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Join meshes of the same material into one."""
    starts = np.cumsum([0] + [len(mesh.points) for mesh in meshes[:-1]])
    columns = map(np.concatenate, zip(*(mesh.columns for mesh in meshes), strict=True))
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh.of_columns(meshes[0].material, columns, np.concatenate(triangles))


def join_materials(meshes: Sequence[Mesh]) -> list[Mesh]:
    """Join meshes into one for each material, sorted by material."""
    materials = sorted({mesh.material for mesh in meshes})
    return [join([mesh for mesh in meshes if mesh.material == name]) for name in materials]


def cut(mesh: Mesh, cell_m: float) -> list[Mesh]:
    """Cut a mesh into squares of `cell_m`, so that a renderer can skip those out of sight."""
    cells = np.floor(mesh.points[mesh.triangles].mean(1)[:, :2] / cell_m).astype(int)
    _, number = np.unique(cells, axis=0, return_inverse=True)
    number = number.reshape(-1)
    pieces = []
    for square in range(number.max() + 1):
        used, renumbered = np.unique(mesh.triangles[number == square], return_inverse=True)
        columns = (values[used] for values in mesh.columns)
        pieces.append(Mesh.of_columns(mesh.material, columns, renumbered.reshape(-1, 3)))
    return pieces
