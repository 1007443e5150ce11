"""What stands on the ground: trees, bushes, rocks, pylons, and stacks of tyres in the bends."""

import numpy as np

from simulator.scenery.ground import Ground
from simulator.scenery.mesh import Mesh, join
from simulator.scenery.textures import PLANTS
from simulator.track import Track

SIZES_M = {  # width and height
    "pine": (4.6, 9.5),
    "tall_pine": (4.4, 12.0),
    "round_tree": (5.6, 9.0),
    "bush": (6.0, 2.6),
    "reeds": (3.0, 2.0),
    "pylon": (9.0, 26.0),
    "tyres": (1.7, 1.0),
    "sign": (1.0, 1.6),
}
FAR_M = 90.0  # from the road: what stands there is seen through air, and is drawn bluish


def standing_meshes(track: Track, ground: Ground, quality: str) -> list[Mesh]:
    """All of it; `quality="simple"` keeps a third."""
    share = 1.0 if quality == "full" else 1 / 3
    around = track.surroundings
    rng = np.random.default_rng(around.seed + 100)
    meshes = [
        *_forest(track, ground, rng, round(around.trees * share)),
        *_bushes(ground, rng, round(around.bushes * share)),
        *_pylons(track, ground, rng, around.poles),
        *_tyres(track, ground),
    ]
    stones = [_rock(ground, rng, one) for one in _scatter(ground, rng, round(around.rocks * share))]
    return [join(group) for group in (meshes, stones) if group]


def _forest(track: Track, ground: Ground, rng: np.random.Generator, count: int) -> list[Mesh]:
    """Trees in groups near the road, and a crowd on the rim."""
    near = _scatter(ground, rng, count // 2, low=10.5, high=60)
    far = _scatter(ground, rng, count - len(near), low=60, high=400)
    kinds = ("pine", "tall_pine", "tall_pine", "round_tree")
    return [
        _crossed(ground, rng, xy, kinds[rng.integers(len(kinds))]) for xy in np.vstack([near, far])
    ]


def _bushes(ground: Ground, rng: np.random.Generator, count: int) -> list[Mesh]:
    return [
        _crossed(ground, rng, xy, "bush" if rng.random() < 0.45 else "reeds")
        for xy in _scatter(ground, rng, count, low=9.5, high=45)
    ]


def _pylons(track: Track, ground: Ground, rng: np.random.Generator, count: int) -> list[Mesh]:
    """A row across the land."""
    if count == 0:
        return []
    middle = track.xyz[:, :2].mean(0)
    row = middle + np.linspace(-0.8, 0.8, count)[:, None] * (ground.high - middle)[None] * (1, -0.6)
    apart, _ = ground.near_road.query(row)
    return [_crossed(ground, rng, xy, "pylon") for xy in row[apart > 20]]


def _tyres(track: Track, ground: Ground) -> list[Mesh]:
    """Stacks along the outside of bends that have a dirt verge."""
    meshes = []
    rng = np.random.default_rng(0)
    for distance in np.arange(0, track.length, 6.0):
        verge = track.verge_at(float(distance))
        for side, kind in ((-1, verge.left), (1, verge.right)):
            if kind == "dirt":
                heading = float(track.heading_at(distance))
                right = np.array([np.sin(heading), -np.cos(heading)])
                xy = track.at(distance)[:2] + side * (track.width / 2 + 5.5) * right
                meshes.append(_crossed(ground, rng, xy, "tyres", lift=0.45))
    return meshes


def _scatter(
    ground: Ground, rng: np.random.Generator, count: int, low: float = 16.0, high: float = 150.0
) -> np.ndarray:
    """Places float [count, 2] on dry land, between `low` and `high` metres from the road."""
    found = np.empty((0, 2))
    while len(found) < count:
        xy = rng.uniform(ground.low + 8, ground.high - 8, (8 * count, 2))
        apart, _ = ground.near_road.query(xy)
        # Groups, with clearings between them.
        dense = ground._noise(xy, 40, 2) > rng.uniform(0.15, 0.65, len(xy))
        xy = xy[(apart > low) & (apart < high) & dense & ~ground.in_water(xy)]
        found = np.concatenate([found, xy])
    return found[:count]


def _crossed(
    ground: Ground, rng: np.random.Generator, xy: np.ndarray, kind: str, lift: float = -0.1
) -> Mesh:
    """Two upright pictures at right angles, standing on the ground."""
    width, height = np.array(SIZES_M[kind]) * rng.uniform(0.75, 1.3)
    turn = rng.uniform(0, np.pi)
    z = float(ground.height(xy[None])[0]) + lift
    points, uv, triangles = [], [], []
    column = PLANTS.index(kind)
    inset = 0.5 / 64
    for number, angle in enumerate((turn, turn + np.pi / 2)):
        reach = np.array([np.cos(angle), np.sin(angle)]) * width / 2
        for sign, across in ((-1, inset), (1, 1 - inset)):
            for up, v in ((0, 0.004), (height, 1.0)):
                points.append([*(xy + sign * reach), z + up])
                uv.append([(column + across) / len(PLANTS), v])
        first = 4 * number
        triangles += [[first, first + 1, first + 3], [first, first + 3, first + 2]]
    apart, _ = ground.near_road.query(xy)
    air = float(np.clip((apart - FAR_M) / 120, 0, 0.55))
    tone = np.array([1.0, 1.0, 1.0]) * rng.uniform(0.8, 1.1)
    colour = tone * (1 - air) + np.array([0.95, 1.25, 1.7]) * air
    return Mesh(
        "plants",
        np.array(points),
        np.tile([0.0, 0.0, 1.0], (8, 1)),
        np.tile(colour, (8, 1)),
        np.array(uv),
        np.array(triangles),
    )


def _rock(ground: Ground, rng: np.random.Generator, xy: np.ndarray) -> Mesh:
    """A boulder: a rough, flattened half sphere."""
    around, up = 9, 4
    size = rng.uniform(1.0, 4.5) * np.array([1.0, rng.uniform(0.6, 1.0), rng.uniform(0.4, 0.8)])
    angle = np.linspace(0, 2 * np.pi, around)
    height = np.linspace(-0.2, 1, up)
    ring = np.sqrt(1 - np.clip(height, 0, 1) ** 2)
    unit = np.stack(
        np.broadcast_arrays(
            ring[:, None] * np.cos(angle), ring[:, None] * np.sin(angle), height[:, None]
        ),
        -1,
    )
    rough = rng.uniform(0.85, 1.15, (up, around, 1))
    rough[:, -1] = rough[:, 0]
    points = (unit * rough * size).reshape(-1, 3)
    points += [*xy, float(ground.height(xy[None])[0])]
    normals = (unit / size).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    index = np.arange(up * around).reshape(up, around)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    grey = np.array([0.62, 0.56, 0.45]) * rng.uniform(0.8, 1.15)
    uv = np.stack(np.meshgrid(angle, height), -1).reshape(-1, 2)
    return Mesh("rock", points, normals, np.tile(grey, (len(points), 1)), uv, triangles)
