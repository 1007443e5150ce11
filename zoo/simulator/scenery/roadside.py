"""Barriers, signs, lamps and tunnels beside and above the road."""

from collections.abc import Iterator

import numpy as np

from zoo.simulator.scenery import road, verges
from zoo.simulator.scenery.ground import Ground
from zoo.simulator.scenery.mesh import Mesh, grid_mesh, grid_triangles
from zoo.simulator.scenery.plants import Standing
from zoo.simulator.track import LEAVES_M, Track

BARRIER_M, PITCH_M = (1.5, 0.5, 0.8), 3.5  # length, thickness and height; from one to the next
CLOSING_M = 1.8  # from one to the next of the barriers before a side road
CLOSING_AWAY_M = 1.5  # outside of the band of leaves
LAMP_M, LAMPS_APART_M = (4.0, 8.0), 24.0  # width and height
SIGN_M, SIGNS_APART_M, CLOSED_M = (1.5, 2.6), 7.0, (1.3, 1.9)
BEND = 1 / 120  # curvature in 1/m from which signs stand in a bend
VAULT_M, RIM_M, HILL_M = 5.4, 1.1, (13.9, 9.5)  # heights, the rim's width, the hill's half width
SQUARE, POINTS = 3.0, 17  # exponent of an arch (2: an ellipse), and its points
GREY, DARK = (0.36, 0.36, 0.355), (0.17, 0.15, 0.14)  # a portal's rim, and a vault


def roadside_meshes(track: Track, ground: Ground) -> list[Mesh]:
    """Return barriers and tunnels; no tunnel where parts of the road are near each other."""
    places = [*_barriers(track)]
    meshes = [_barrier_mesh(track, *np.array(places).T)] if places else []
    for stretch in track.stretches:
        if stretch.tunnel and ground.room is None:
            meshes += _tunnel(track, ground, road.points_along(stretch.start, stretch.end, 2.0))
    return meshes


def road_signs(track: Track) -> list[Standing]:
    """Return lamps along barriers, signs behind them in bends, and those of closed roads."""
    behind = LEAVES_M + BARRIER_M[1] + 0.6
    kinds = (("lamp", LAMP_M, LAMPS_APART_M), ("chevron", SIGN_M, SIGNS_APART_M))
    places = [
        (kind, size, distance, side, behind)
        for kind, size, apart in kinds
        for distance, side in _along(track, "barriers", apart)
        if kind == "lamp" or side * float(track.curvature_at(distance)) > BEND
    ]
    places += [
        ("road_closed", CLOSED_M, distance, side, LEAVES_M + CLOSING_AWAY_M + 0.5)
        for distance, side in _along(track, "closed", CLOSING_M)
    ]
    standing = []
    for kind, (width, height), distance, side, away in places:
        outward = side * road.rightwards(track, np.array([distance]))[0]
        foot = track.at(distance) + (float(track.width_at(distance)) / 2 + away) * outward
        turn = float(np.arctan2(outward[1], outward[0]))  # of the right border: a sign points in
        standing.append(Standing(kind, foot, width, height, turn, 1.0))
    return standing


def _along(track: Track, kind: str, apart_m: float) -> Iterator[tuple[float, int]]:
    """Yield distances within stretches with a kind of verge, and the side, -1 or 1."""
    for start, end in road.runs(track):
        verge = track.verge_at((start + end) / 2)
        count = 3 if kind == "closed" else int((end - start) / apart_m)
        for side, beside in ((-1, verge.left), (1, verge.right)):
            if beside == kind:
                for number in range(count):
                    yield (start + end) / 2 + (number - (count - 1) / 2) * apart_m, side


def _barriers(track: Track) -> Iterator[tuple[float, int, float]]:
    """Yield each barrier's distance, side, and metres from the road's edge to its front."""
    for distance, side in _along(track, "barriers", PITCH_M):
        yield distance, side, LEAVES_M + 0.1
    for distance, side in _along(track, "closed", CLOSING_M):
        yield distance, side, LEAVES_M + CLOSING_AWAY_M


def _barrier_mesh(track: Track, along: np.ndarray, side: np.ndarray, away: np.ndarray) -> Mesh:
    """Return barriers: front, back, ends and top of each."""
    length, thick, height = BARRIER_M
    outward = side[:, None] * road.rightwards(track, along)
    ahead = np.stack([np.cos(track.heading_at(along)), np.sin(track.heading_at(along))], -1)
    ahead = np.c_[ahead, track.grade_at(along)]
    foot = track.at(along) + (road.half_width(track, along) + away)[:, None] * outward
    front, back = [(0.0, -0.3), (0.12, height)], [(thick, -0.3), (thick - 0.12, height)]
    top = [front[1], back[1]]
    # Face, edge, point of the edge: metres ahead, outward and up.
    shape = np.empty((5, 2, 2, 3))
    shape[:3, ..., 0] = np.array([[-length], [length]]) / 2
    shape[:3, ..., 1:] = np.array([front, back, top])[:, None]
    shape[3:, ..., 0] = np.array([-length, length])[:, None, None] / 2  # the ends
    shape[3:, ..., 1:] = [front, back]
    normals = np.array([(0, -1, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0), (1, 0, 0)], float)
    uv = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], indexing="ij"), -1) * np.ones((5, 1, 1, 1))
    uv[2:, ..., 1] = 0.97  # top and ends are plain concrete
    axes = np.stack([ahead, outward, np.broadcast_to([0.0, 0.0, 1.0], ahead.shape)], 1)
    points = foot[:, None] + shape.reshape(-1, 3) @ axes
    first = 4 * np.arange(5 * len(along))[:, None, None]
    return Mesh(
        "hazard",
        points.reshape(-1, 3),
        (np.repeat(normals, 4, axis=0) @ axes).reshape(-1, 3),
        np.full((points.size // 3, 3), 0.8),
        np.tile(uv.reshape(-1, 2), (len(along), 1)),
        (first + grid_triangles(2, 2)).reshape(-1, 3),
    )


def _tunnel(track: Track, ground: Ground, along: np.ndarray) -> list[Mesh]:
    """Return a tunnel's vault, the hill on it, and a portal at each end."""
    half = float(road.half_width(track, along).max()) + LEAVES_M - 0.05
    vault, rim = _arch(half, VAULT_M), _arch(half + RIM_M, VAULT_M + RIM_M)
    hill, soil = _arch(*HILL_M), verges.SOILS[ground.around.ground]
    right, floor = road.rightwards(track, along), track.at(along)
    light = road.daylight(track, along)[:, None, None]

    def placed(arch: np.ndarray) -> np.ndarray:
        points = floor[:, None] + arch[:, :1] * right[:, None]
        return points + arch[:, 1:] * np.array([0.0, 0.0, 1.0])

    meshes = []
    for arch, outward, colour in ((vault, -1, light * DARK), (hill, 1, soil)):
        facing = np.stack([arch[:, 0] / arch[0, 0] ** 2, arch[:, 1] / arch[:, 1].max() ** 2], -1)
        facing *= outward / np.linalg.norm(facing, axis=1, keepdims=True)
        normals = placed(facing) - floor[:, None]
        steps = np.linalg.norm(np.diff(arch, axis=0, prepend=arch[:1]), axis=1).cumsum()
        uv = np.stack(np.broadcast_arrays(along[:, None], steps), -1) / 6.0
        meshes.append(grid_mesh("rock", placed(arch), normals, colour, uv))
    for end, sign in ((0, -1), (-1, 1)):
        ahead = sign * np.array([-right[end, 1], right[end, 0], 0.0])
        for inner, outer, material, colour in (
            (vault, rim, "concrete", GREY),
            (rim, hill, "rock", verges.BLACK_ROCK),
        ):
            arches = np.stack([inner, outer])
            points = np.stack([placed(arch)[end] for arch in arches])
            meshes.append(grid_mesh(material, points, ahead, colour, arches / 6.0))
    return meshes


def _arch(half: float, height: float) -> np.ndarray:
    """Return points of an arch float [N, 2] from left to right: metres to the right, and up."""
    turn = np.linspace(np.pi, 0, POINTS)
    cos, sin = np.cos(turn), np.clip(np.sin(turn), 0, 1)
    power = 2 / SQUARE
    return np.stack([half * np.sign(cos) * np.abs(cos) ** power, height * sin**power], -1)
