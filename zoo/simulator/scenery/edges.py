"""Faces below verges down to lower ground, bridges, and the ends of an open road."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from zoo.simulator.scenery import road, verges
from zoo.simulator.scenery.ground import CLIFFS, Ground
from zoo.simulator.scenery.mesh import Mesh, grid_mesh, join
from zoo.simulator.track import Track

STEP_M = 0.8  # highest step from a verge to the ground without a face
BURIED_M = 0.5  # part of a face below the ground
ACROSS = 15  # points across a cross-section, on each side
BARRIER_M, BARRIER_THICK_M = 0.9, 0.5  # height and thickness of an open road's barrier
DECK_M = 1.1  # height of the deck's side faces below the road
WALL_END_M, WALL_M = 1.0, 0.75  # outer face of the wall outside the road's edge, and its height
PILLAR_M, PILLARS_APART_M = 1.2, 10.0
PILLAR_CLEAR_M = 2.5  # distance of pillars from the edge of the road below


def edge_meshes(track: Track, ground: Ground, step_m: float = road.ALONG_M) -> list[Mesh]:
    """Return faces below verges, where parts of the road are near each other, and road ends."""
    meshes = []
    if ground.room is not None or track.bridge.any():
        for start, end in road.runs(track):
            if not track.on_bridge((start + end) / 2):
                along = road.points_along(start, end, step_m)
                meshes += [_outer_face(track, ground, along, side) for side in (-1, 1)]
                for at, beyond in ((0, along[0] - 0.6), (-1, along[-1] + 0.6)):
                    if track.on_bridge(beyond):
                        meshes.append(_cross_face(track, ground, along, at))
    if not track.closed:
        for at in (0, -1):
            meshes += _road_end(track, ground, at)
    return [mesh for mesh in meshes if len(mesh.triangles)]


def surface(track: Track, ground: Ground, xy: np.ndarray) -> np.ndarray:
    """Return the heights in metres, float [N], on which objects stand at x and y, float [N, 2].

    Between parts of the road near each other that is the higher one of ground and verge.
    """
    if ground.room is None and not ground.coarse:
        return ground.height(xy)
    height = ground.mesh_height(xy)
    apart, nearest = ground.near_standing.query(xy)
    for number in np.flatnonzero(apart < verges.VERGE_END_M):
        sample = ground.standing[nearest[number]]
        along = track.distance[[sample]]
        offset = (xy[number] - track.xyz[sample, :2]) @ road.rightwards(track, along)[0, :2]
        side = 1 if offset > 0 else -1
        away = np.minimum(apart[[number]], _verge_edge(track, ground, along, side))
        verge = track.xyz[sample, 2] + _rise(track, along, side, away)[0]
        height[number] = max(height[number], verge)
    return height


def _verge_edge(track: Track, ground: Ground, along: np.ndarray, side: int) -> np.ndarray:
    """Return the distance of a verge's outer edge from the centreline, float [N]."""
    far = np.minimum(verges.VERGE_END_M, verges.inner_reach(track.curvature_at(along), side))
    if ground.room is None:
        return far
    return np.minimum(far, road.room_at(track, ground.room[(side + 1) // 2], along))


def _rise(track: Track, along: np.ndarray, side: int, offset: np.ndarray) -> np.ndarray:
    """Return a verge's heights above the road float [N], `offset` metres from the centreline."""
    rise = verges.rise_at(
        road.bands_of_run(track, along, side), offset - road.half_width(track, along)
    )
    return rise * road.taper_at(track, along, side)


def _outer_face(track: Track, ground: Ground, along: np.ndarray, side: int) -> Mesh:
    """Return the face from a verge's outer edge down to the ground."""
    edge, right = _verge_edge(track, ground, along, side), road.rightwards(track, along)
    top = track.at(along) + (side * edge)[:, None] * right
    top[:, 2] += _rise(track, along, side, edge)
    return _face(ground, top, side * right)


def _cross_face(track: Track, ground: Ground, along: np.ndarray, at: int) -> Mesh:
    """Return the face across the road and its verges at the first or last point of a run."""
    here = along[[at]]
    lateral, rise = [], []
    for side in (-1, 1):
        half = road.half_width(track, here)[0]
        away = np.linspace(0, max(_verge_edge(track, ground, here, side)[0] - half, 0), ACROSS)
        lateral.append(side * (half + away))
        rises = verges.rise_at(road.bands_of_run(track, along, side), away)
        rise.append(rises * road.taper_at(track, here, side))
    lateral[0], rise[0] = lateral[0][::-1], rise[0][::-1]
    right = road.rightwards(track, here)
    top = track.at(here) + np.concatenate(lateral)[:, None] * right
    top[:, 2] += np.concatenate(rise)
    ahead = np.array([-right[0, 1], right[0, 0], 0.0]) * (1 if at else -1)
    return _face(ground, top, np.broadcast_to(ahead, top.shape))


def _face(ground: Ground, top: np.ndarray, normal: np.ndarray) -> Mesh:
    """Return an upright face from the points of its upper edge float [N, 3] to the ground."""
    floor = ground.mesh_height(top[:, :2])
    bottom = top.copy()
    high = top[:, 2] - floor > STEP_M
    bottom[:, 2] = np.where(high, floor - BURIED_M, top[:, 2])
    points = np.stack([top, bottom], 1)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(top, axis=0), axis=1))]) / 6.0
    uv = np.stack(np.broadcast_arrays(along[:, None], points[..., 2] / 6.0), -1)
    face = grid_mesh("rock", points, normal[:, None], CLIFFS[ground.around.ground], uv)
    return replace(face, triangles=face.triangles[high[face.triangles // 2].any(1)])


def _road_end(track: Track, ground: Ground, at: int) -> list[Mesh]:
    """Return a round place behind the road's first (0) or last (-1) point, and a barrier on it."""
    here = track.distance[[at]]
    right = road.rightwards(track, here)[0]
    ahead = np.array([-right[1], right[0], 0.0]) * (1 if at else -1)
    centre, half = track.at(here)[0], float(road.half_width(track, here)[0])
    turn = np.linspace(-np.pi / 2, np.pi / 2, 25)
    spokes = np.cos(turn)[:, None] * ahead + np.sin(turn)[:, None] * right
    apart = track.xyz[:, :2] - centre[:2]
    behind = apart[apart @ ahead[:2] > 1]
    nearest = np.linalg.norm(behind, axis=1).min(initial=np.inf)
    most = np.clip(nearest - track.widths.max() / 2 - verges.CLEAR_M, half + 1, verges.VERGE_END_M)
    points = centre + np.array([0.0, half, most])[:, None] * spokes[:, None]
    points[..., 2] += np.array([0.0, 0.0, 0.2])
    soil = verges.SOILS[ground.around.ground]
    place = grid_mesh("ground", points, (0.0, 0.0, 1.0), soil, points[..., :2] / 6.0)
    cross = _cross_face(track, ground, road.points_along(*road.runs(track)[at]), at)
    rim = _face(ground, points[:, -1], spokes)
    return [place, cross, rim, *_barrier(centre + 0.3 * ahead, right, ahead, half + 1.0)]


def _barrier(foot: np.ndarray, right: np.ndarray, ahead: np.ndarray, half: float) -> list[Mesh]:
    """Return a red and white barrier across the road: its front, top and back."""
    across = np.linspace(-half, half, 9)
    up = np.array([0.0, 0.0, 1.0])
    profile = ((0, -0.3), (0, BARRIER_M), (BARRIER_THICK_M, BARRIER_M), (BARRIER_THICK_M, -0.3))
    corners = [away * ahead + rise * up for away, rise in profile]
    sides = (("stripes", -ahead), ("concrete", up), ("stripes", ahead))
    meshes = []
    for (material, normal), low, high in zip(sides, corners, corners[1:], strict=False):
        points = foot + across[:, None, None] * right + np.stack([low, high])[None]
        uv = np.full((len(across), 2, 2), 0.5)
        uv[..., 0] = across[:, None] / 2.0
        meshes.append(grid_mesh(material, points, normal, verges.CONCRETE, uv))
    return meshes


def bridge_meshes(track: Track, ground: Ground) -> list[Mesh]:
    """Return the parts of the track's bridges below the road; the walls are part of the road."""
    meshes = []
    for start, end in road.runs(track):
        if track.on_bridge((start + end) / 2):
            along = road.points_along(start, end)
            meshes.append(_deck(track, along))
            meshes += _pillars(track, ground, along)
    return meshes


def _deck(track: Track, along: np.ndarray) -> Mesh:
    """Return the side faces and the underside, as a strip around the deck's lower edges."""
    right = road.rightwards(track, along)
    half = road.half_width(track, along) + WALL_END_M
    up = np.array([0.0, 0.0, 1.0])
    profile = [(-1, WALL_M, -1), (-1, -DECK_M, -1), (-1, -DECK_M, 0), (1, -DECK_M, 0)]
    profile += [(1, -DECK_M, 1), (1, WALL_M, 1)]
    points, normals = [], []
    for side, rise, faces in profile:
        points.append(track.at(along) + (side * half)[:, None] * right + rise * up)
        normals.append(faces * right if faces else np.broadcast_to(-up, right.shape))
    grid = np.stack(points, 1)
    around = np.array([0.0, DECK_M, DECK_M, DECK_M + 9, DECK_M + 9, 2 * DECK_M + 9])
    uv = np.stack(np.broadcast_arrays(along[:, None] / 4.0, around / 4.0), -1)
    return grid_mesh("concrete", grid, np.stack(normals, 1), np.array(verges.CONCRETE) * 0.85, uv)


def _pillars(track: Track, ground: Ground, along: np.ndarray) -> list[Mesh]:
    """Return pairs of pillars down to the ground, beside the road below."""
    low = ~track.bridge
    below = cKDTree(track.xyz[low, :2])
    room = track.widths.max() / 2 + PILLAR_CLEAR_M
    count = max(round((along[-1] - along[0]) / PILLARS_APART_M), 1)
    meshes = []
    for distance in np.linspace(along[0], along[-1], count + 1):
        here = np.array([distance])
        right = road.rightwards(track, here)[0]
        for side in (-1, 1):
            foot = track.at(here)[0] + side * (road.half_width(track, here)[0] - 0.2) * right
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
    across, z = np.array([[-1], [1]]), np.array([top, bottom])
    uv = np.stack(np.broadcast_arrays(across * PILLAR_M / 8, z / 4.0), -1)
    faces = []
    for normal in (right, ahead, -right, -ahead):
        beside = np.array([-normal[1], normal[0], 0.0])
        corners = foot + PILLAR_M / 2 * (normal + across * beside)
        points = np.repeat(corners[:, None], 2, axis=1)
        points[..., 2] = z
        faces.append(grid_mesh("concrete", points, normal, np.array(verges.CONCRETE) * 0.85, uv))
    return join(faces)
