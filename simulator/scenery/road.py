"""The road and its verges: bands along the centreline.

Widths were measured on the original's frames of a straight, projected to a view from above: 6.4 m
between the inner yellow lines; a dark strip and a second line; about 1.4 m of paved shoulder; then
a concrete bank of about 2 m, pale in the sun and blue-grey in the shade.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from simulator.scenery.mesh import Mesh, grid_triangles, join
from simulator.track import Track

ALONG_M = 1.0
BANK = 0.9  # slope for the light: the original's bank is cream in the sun, blue-grey in shade
VERGE_END_M = 14.0  # from the centreline; the ground's mesh continues from there

YELLOW, GUTTER = (0.66, 0.62, 0.36), (0.23, 0.22, 0.17)
ASPHALT, SHOULDER = (0.356, 0.355, 0.366), (0.40, 0.40, 0.40)
COBBLES, CONCRETE = (0.49, 0.43, 0.435), (0.95, 0.92, 0.77)
SAND, PINK_SAND = (0.55, 0.40, 0.26), (0.68, 0.50, 0.40)
GRASS, ROCK, WALL = (0.55, 0.49, 0.27), (0.60, 0.55, 0.46), (0.04, 0.035, 0.03)
FOREST, WHITE = (0.32, 0.35, 0.19), (0.75, 0.75, 0.72)


@dataclass(frozen=True)
class Band:
    """A strip of one material: metres from the road's edge, heights above the road."""

    start: float
    end: float
    rise_start: float
    rise_end: float
    material: str
    colour: tuple[float, float, float]
    repeat: float = 4.0  # metres that one texture covers
    steep: float | None = None  # rise per metre assumed for its light; None for the real one


def verge_bands(
    kind: str, shoulder: float, room: float, ground: str, cobbled: bool = False
) -> list[Band]:
    """Return the bands outside the road's edge for a kind of verge, up to `room` metres."""
    paving = _paving(cobbled)
    # The bridge's walls are nearly black in the original; walls of a mountain road are stone.
    wall = ("plain", WALL) if cobbled else ("rock", ROCK, 3.0)
    soil = SAND if ground == "sand" else FOREST
    grass = GRASS if ground == "sand" else FOREST
    line = [
        Band(0.0, 0.10, 0, 0, "plain", YELLOW),
        Band(0.10, 0.42, 0, 0, "plain", GUTTER),
        Band(0.42, 0.50, 0, 0, "plain", YELLOW),
    ]
    paved = 0.5 + shoulder
    if kind == "kerb":
        return [
            *line,
            Band(0.5, paved, 0, 0, "asphalt", SHOULDER),
            Band(paved, paved + 1.8, 0, 0.4, "concrete", CONCRETE, steep=BANK),
            Band(paved + 1.8, room, 0.4, 0.2, "ground", soil),
        ]
    if kind == "stripes":
        return [
            *line,
            Band(0.5, 2.1, 0, 0.12, "stripes", (0.92, 0.92, 0.95), 1.1),
            Band(2.1, 3.8, 0.12, 0.4, "concrete", CONCRETE, steep=BANK),
            Band(3.8, room, 0.4, 0.2, "ground", soil),
        ]
    if kind == "dirt":
        return [
            Band(0.0, 1.2, 0, 0.05, "ground", PINK_SAND, steep=0.0),
            Band(1.2, room, 0.05, 0.2, "ground", soil, 6.0),
        ]
    if kind == "wall":
        return [
            Band(0.0, 0.7, 0, 0, *paving),
            Band(0.7, 0.72, 0, 0.75, *wall),
            Band(0.72, 1.0, 0.75, 0.75, *wall),
            Band(1.0, 1.02, 0.75, -4.0, *wall),
        ]
    if kind == "rock":
        return [
            Band(0.0, 0.12, 0, 0, "plain", WHITE),
            Band(0.12, 0.9, 0, 0.1, "ground", soil),
            Band(0.9, 1.9, 0.1, 3.2, "rock", ROCK, 6.0),
            Band(1.9, 3.4, 3.2, 5.0, "rock", ROCK, 6.0),
            Band(3.4, room, 5.0, 6.0, "ground", grass, 8.0),
        ]
    if kind == "drop":
        return [
            Band(0.0, 0.12, 0, 0, "plain", WHITE),
            Band(0.12, 0.9, 0, 0, "ground", soil),
            Band(0.9, 1.3, 0, 0.35, "concrete", CONCRETE),
            Band(1.3, 3.5, 0.35, -2.0, "ground", grass, 6.0),
            Band(3.5, room, -2.0, -5.0, "ground", grass, 6.0),
        ]
    return [
        *line,
        Band(0.5, paved + 1.4, 0, 0.1, "asphalt", SHOULDER),
        Band(paved + 1.4, room, 0.1, 0.25, "ground", grass, 6.0),
    ]


def road_meshes(track: Track) -> list[Mesh]:
    """Return meshes of road, lines, shoulders and verges of the whole lap, one per material."""
    meshes = []
    for start, end in _runs(track):
        stretch = track.stretch_at((start + end) / 2)
        verge = track.verge_at((start + end) / 2)
        along = np.linspace(start, end, max(round((end - start) / ALONG_M), 1) + 1)
        cobbled = stretch is not None and stretch.paving == "cobbles"
        half = track.width / 2
        for band in _carriageway(half, cobbled, track.centre_line):
            meshes.append(_band_mesh(track, along, band, 1, 0.0, columns=9))
        for side, kind in ((-1, verge.left), (1, verge.right)):
            room = VERGE_END_M - half
            ground = track.surroundings.ground
            for band in verge_bands(kind, track.shoulder, room, ground, cobbled):
                meshes.append(_band_mesh(track, along, band, side, half))
    return [join([m for m in meshes if m.material == name]) for name in _materials(meshes)]


def _carriageway(half: float, cobbled: bool, centre_line: bool) -> list[Band]:
    """Return the bands between the road's edges, from left to right."""
    paving = _paving(cobbled)
    if not centre_line:
        return [Band(-half, half, 0, 0, *paving)]
    return [
        Band(-half, -0.08, 0, 0, *paving),
        Band(-0.08, 0.08, 0, 0, "plain", YELLOW),
        Band(0.08, half, 0, 0, *paving),
    ]


def _paving(cobbled: bool) -> tuple[str, tuple[float, float, float], float]:
    """Return the paving's material, colour and repeat."""
    return ("cobbles", COBBLES, 2.0) if cobbled else ("asphalt", ASPHALT, 4.0)


def _materials(meshes: list[Mesh]) -> list[str]:
    return sorted({mesh.material for mesh in meshes})


def _runs(track: Track) -> list[tuple[float, float]]:
    """Return the spans of distances in which paving and verges stay the same."""
    ends = {0.0, track.length}
    for stretch in track.stretches:
        ends |= {stretch.start, min(stretch.end, track.length)}
    ordered = sorted(ends)
    return [(start, end) for start, end in pairwise(ordered) if end - start > 0.01]


def _band_mesh(
    track: Track, along: np.ndarray, band: Band, side: int, edge: float, columns: int = 2
) -> Mesh:
    """Return a band's mesh; `band.start` is measured from `edge`, outwards on `side`."""
    across = np.linspace(band.start, band.end, columns)
    rise = np.interp(across, (band.start, band.end), (band.rise_start, band.rise_end))
    offset = edge + across
    middle = track.at(along)
    heading = track.heading_at(along)
    right = np.stack([np.sin(heading), -np.cos(heading), np.zeros_like(heading)], -1)
    # Inside a bend a wide verge would fold over itself, so it ends before the bend's centre.
    bend = -track.curvature_at(along) * side
    reach = np.where(bend > 0, 0.85 / np.maximum(bend, 1e-9), np.inf)
    lateral = np.minimum(offset[None], reach[:, None]) * side
    points = middle[:, None] + lateral[..., None] * right[:, None]
    points[..., 2] += rise
    up = np.array([0.0, 0.0, 1.0])
    slope = band.steep
    if slope is None:
        slope = (band.rise_end - band.rise_start) / (band.end - band.start)
    normal = up - slope * side * right
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    count = len(along) * columns
    uv = np.stack(np.broadcast_arrays(along[:, None] / band.repeat, offset[None] / band.repeat), -1)
    if band.material == "stripes":
        uv[..., 1] = 0.5
    return Mesh(
        band.material,
        points.reshape(-1, 3),
        np.repeat(normal, columns, 0),
        np.broadcast_to(np.array(band.colour), (count, 3)).copy(),
        uv.reshape(-1, 2),
        grid_triangles(len(along), columns),
    )
