"""Bridges of a road over itself: side faces, underside and pillars."""

import numpy as np
from scipy.spatial import cKDTree

from simulator.scenery.bands import CONCRETE
from simulator.scenery.ground import Ground
from simulator.scenery.mesh import Mesh, grid_triangles
from simulator.scenery.road import half_width, points_along, rightwards, runs
from simulator.track import Track

DECK_M = 1.1  # height of the deck's side faces below the road
WALL_END_M, WALL_M = 1.0, 0.75  # outer face of the wall outside the road's edge, and its height
PILLAR_M, PILLARS_APART_M = 1.2, 10.0
CLEAR_M = 2.5  # distance of pillars from the edge of the road below


def bridge_meshes(track: Track, ground: Ground) -> list[Mesh]:
    """Return the parts of the track's bridges below the road; the walls are part of the road."""
    meshes = []
    for start, end in runs(track):
        if track.on_bridge((start + end) / 2):
            along = points_along(start, end)
            meshes.append(_deck(track, along))
            meshes += _pillars(track, ground, along)
    return meshes


def _deck(track: Track, along: np.ndarray) -> Mesh:
    """Return the side faces and the underside, as a strip around the deck's lower edges."""
    right = rightwards(track, along)
    half = half_width(track, along) + WALL_END_M
    up = np.array([0.0, 0.0, 1.0])
    profile = ((-1, WALL_M, -1), (-1, -DECK_M, -1), (-1, -DECK_M, 0), (1, -DECK_M, 0))
    profile += ((1, -DECK_M, 1), (1, WALL_M, 1))
    points, normals = [], []
    for side, rise, faces in profile:
        points.append(track.at(along) + (side * half)[:, None] * right + rise * up)
        normals.append(faces * right if faces else np.broadcast_to(-up, right.shape))
    grid = np.stack(points, 1)
    around = np.array([0.0, DECK_M, DECK_M, DECK_M + 9, DECK_M + 9, 2 * DECK_M + 9])
    uv = np.stack(np.broadcast_arrays(along[:, None] / 4.0, around / 4.0), -1)
    return Mesh(
        "concrete",
        grid.reshape(-1, 3),
        np.stack(normals, 1).reshape(-1, 3),
        np.tile(np.array(CONCRETE) * 0.85, (grid.size // 3, 1)),
        uv.reshape(-1, 2),
        grid_triangles(len(along), len(profile)),
    )


def _pillars(track: Track, ground: Ground, along: np.ndarray) -> list[Mesh]:
    """Return pairs of pillars down to the ground, beside the road below."""
    low = ~track.bridge
    below = cKDTree(track.xyz[low, :2])
    room = track.widths.max() / 2 + CLEAR_M
    count = max(round((along[-1] - along[0]) / PILLARS_APART_M), 1)
    meshes = []
    for distance in np.linspace(along[0], along[-1], count + 1):
        here = np.array([distance])
        right = rightwards(track, here)[0]
        for side in (-1, 1):
            foot = track.at(here)[0] + side * (half_width(track, here)[0] - 0.2) * right
            floor = float(ground.mesh_height(foot[None, :2])[0])
            # Only where the road below passes; the nearest ground may be the bridge's own end.
            near, number = below.query(foot[:2])
            beneath = track.xyz[low][number, 2] < foot[2] - DECK_M - 2
            if (near > room or not beneath) and foot[2] - DECK_M - floor > 1:
                meshes.append(_pillar(foot, right, foot[2] - DECK_M, floor - 1))
    return meshes


def _pillar(foot: np.ndarray, right: np.ndarray, top: float, bottom: float) -> Mesh:
    """Return the four upright faces of a pillar."""
    ahead = np.array([-right[1], right[0], 0.0])
    outwards = [right, ahead, -right, -ahead]
    points, normals, uv = [], [], []
    for normal in outwards:
        beside = np.array([-normal[1], normal[0], 0.0])
        for across in (-1, 1):
            for z in (top, bottom):
                corner = foot + PILLAR_M / 2 * (normal + across * beside)
                points.append([*corner[:2], z])
                normals.append(normal)
                uv.append([across * PILLAR_M / 8, z / 4.0])
    faces = np.array([(0, 1, 3), (0, 3, 2)])
    return Mesh(
        "concrete",
        np.array(points),
        np.array(normals),
        np.tile(np.array(CONCRETE) * 0.85, (16, 1)),
        np.array(uv),
        np.concatenate([faces + 4 * number for number in range(4)]),
    )
