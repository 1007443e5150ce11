"""Objects on the ground: trees, bushes, rocks, pylons, and stacks of tyres in bends."""

from dataclasses import dataclass

import numpy as np

from zoo.simulator.scenery.edges import surface
from zoo.simulator.scenery.ground import Ground
from zoo.simulator.scenery.mesh import Mesh, grid_mesh, grid_triangles, thin
from zoo.simulator.scenery.road import rightwards
from zoo.simulator.scenery.textures import PLANTS, SIGNS, TILES
from zoo.simulator.track import Track

SIZES_M = {  # width and height
    "pine": (4.6, 9.5),
    "tall_pine": (4.4, 12.0),
    "round_tree": (5.6, 9.0),
    "bush": (6.0, 2.6),
    "reeds": (3.0, 2.0),
    "pylon": (9.0, 26.0),
    "tyres": (1.7, 1.0),
    "red_tree": (6.5, 9.0),
    "brown_tree": (5.5, 9.5),
}
FOREST = ("pine", "tall_pine", "tall_pine", "round_tree")
AUTUMN = ("red_tree", "red_tree", "brown_tree", "brown_tree", "tall_pine")
BESIDE_M = 60.0
FAR_M = 90.0  # distance from the road beyond which objects get bluish
MOST_MISSES = 200_000  # places tried in a row without one for a plant


@dataclass(frozen=True)
class Standing:
    """An upright object, drawn as two crossed images, or one of a sign.

    Attributes:
        kind: key of `SIZES_M`, or a sign.
        foot: position of its foot, float [3].
        width: width in metres.
        height: height in metres.
        turn: angle of its first image in radians.
        tone: factor on its colours.
    """

    kind: str
    foot: np.ndarray
    width: float
    height: float
    turn: float
    tone: float


def place_standing(track: Track, ground: Ground, quality: str) -> list[Standing]:
    """Place trees, bushes, pylons and tyres; quality simple has a third of the plants."""
    share = 1 / 3 if quality == "simple" else 1.0
    around = track.surroundings
    rng = np.random.default_rng(around.seed + 100)
    trees, bushes = round(around.trees * share), round(around.bushes * share)
    # Half of the trees near the road, the others farther away.
    near = scatter(ground, rng, trees // 2, low=around.clear, high=60)
    far = scatter(ground, rng, trees - len(near), low=60, high=400)
    low = scatter(ground, rng, bushes, low=9.5, high=45)
    row = _row_of_poles(track, ground, around.poles)
    kinds: list[tuple[str, ...]]
    kinds = [AUTUMN if around.ground == "autumn" else FOREST] * (len(near) + len(far))
    kinds += [("bush", "reeds")] * len(low) + [("pylon",)] * len(row)
    # Between parts of the road near each other there is no room for tyres.
    stacks = _beside_dirt(track) if ground.room is None else np.empty((0, 2))
    kinds += [("tyres",)] * len(stacks)
    places = np.concatenate([near, far, low, row, stacks])
    heights = surface(track, ground, places)
    standing = []
    for xy, z, choice in zip(places, heights, kinds, strict=True):
        kind = choice[rng.integers(len(choice))]
        width, height = np.array(SIZES_M[kind]) * rng.uniform(0.75, 1.3)
        # Tyres stand on the verge, which is above the ground.
        foot = np.array([*xy, z + (0.45 if kind == "tyres" else -0.1)])
        turn, tone = rng.uniform(0, np.pi), rng.uniform(0.8, 1.1)
        standing.append(Standing(kind, foot, float(width), float(height), turn, tone))
    return standing


def standing_mesh(standing: list[Standing], ground: Ground) -> Mesh:
    """Return the mesh of all objects: two upright rectangles at right angles for each.

    On coarse ground all but tyres have one. It faces a car that comes along the road or, far from
    the road, one beside it.
    """
    feet = np.array([upright.foot for upright in standing]).reshape(-1, 3)
    turn, width, height, tone, tile = np.array(
        [
            (upright.turn, upright.width, upright.height, upright.tone, PLANTS.index(upright.kind))
            for upright in standing
        ]
    ).T[..., None]
    apart, nearest = (values[:, None] for values in ground.near_road.query(feet[:, :2]))
    signs = tile >= PLANTS.index(SIGNS[0])
    alone = ground.coarse & (tile != PLANTS.index("tyres")) & ~signs
    right = ground.track.rightwards[nearest[:, 0]]
    turned = np.where(apart > BESIDE_M, right[:, ::-1] * (-1, 1), right)
    turn = np.where(alone, np.arctan2(turned[:, 1:], turned[:, :1]), turn)
    air = np.clip((apart - FAR_M) / 120, 0, 0.55)
    colours = tone * (1 - air) + np.array([0.95, 1.25, 1.7]) * air
    inset = 0.5 / 64
    u = (tile + np.array([inset, 1 - inset])) / TILES
    angle = np.concatenate([turn, turn + np.pi / 2], 1)
    half = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1) * width[..., None] / 2
    ends = feet[:, None, None] + np.array([[-1], [1]]) * half[:, :, None]
    rise = height[..., None, None] * np.array([[0.0, 0, 0], [0, 0, 1]])
    points = ends[..., None, :] + rise[:, None]  # object, rectangle, end, foot or top
    v = np.array([0.004, 1.0])
    uv = np.stack(np.broadcast_arrays(u[:, None, :, None], v, points[..., 0])[:2], -1)
    colours = np.broadcast_to(colours[:, None, None, None], points.shape)
    drawn = np.flatnonzero(~(alone | signs) | [True, False])
    first = 4 * drawn[:, None, None]
    return Mesh(
        "plants",
        points.reshape(-1, 3),
        np.tile([0.0, 0.0, 1.0], (points.size // 3, 1)),
        colours.reshape(-1, 3),
        uv.reshape(-1, 2),
        (first + grid_triangles(2, 2)).reshape(-1, 3),
    )


def boulder_meshes(track: Track, ground: Ground, quality: str) -> list[Mesh]:
    """Return a mesh for each of the track's boulders, of which there may be none."""
    count = round(track.surroundings.rocks * (1 / 3 if quality == "simple" else 1.0))
    rng = np.random.default_rng(track.surroundings.seed + 200)
    xy = scatter(ground, rng, count)
    boulders = [_boulder(rng, foot) for foot in np.c_[xy, ground.height(xy)]]
    return (
        [thin(boulder, 9, np.array([0, 2, 3]), 2) for boulder in boulders]
        if ground.coarse
        else boulders
    )


def scatter(
    ground: Ground, rng: np.random.Generator, count: int, low: float = 16.0, high: float = 150.0
) -> np.ndarray:
    """Return places float [count, 2] on land, between `low` and `high` metres from the road.

    There are fewer where a track leaves no room for them, such as on an island.
    """
    found, misses = np.empty((0, 2)), 0
    while len(found) < count and misses < MOST_MISSES:
        xy = rng.uniform(ground.low + 8, ground.high - 8, (8 * count, 2))
        apart, _ = ground.near_road.query(xy)
        # Plants stand in groups, with clearings between them.
        dense = ground.density(xy) > rng.uniform(0.15, 0.65, len(xy))
        xy = xy[(apart > low) & (apart < high) & dense & ~ground.in_water(xy)]
        found = np.concatenate([found, xy])
        misses = 0 if len(xy) else misses + 8 * count
    return found[:count]


def _row_of_poles(track: Track, ground: Ground, count: int) -> np.ndarray:
    """Return places float [N, 2] in a row across the land, except those near the road."""
    middle = track.xyz[:, :2].mean(0)
    row = middle + np.linspace(-0.8, 0.8, count)[:, None] * (ground.high - middle) * (1, -0.6)
    return row[ground.near_road.query(row)[0] > 20]


def _beside_dirt(track: Track) -> np.ndarray:
    """Return places float [N, 2] every 6 m along dirt verges."""
    places = []
    for distance in np.arange(0, track.length, 6.0):
        verge = track.verge_at(float(distance))
        right = rightwards(track, np.array([distance]))[0, :2]
        away = track.width_at(distance) / 2 + 5.5
        sides = [side for side, kind in ((-1, verge.left), (1, verge.right)) if kind == "dirt"]
        places += [track.at(distance)[:2] + side * away * right for side in sides]
    return np.array(places).reshape(-1, 2)


def _boulder(rng: np.random.Generator, foot: np.ndarray) -> Mesh:
    """Return a boulder: a rough, flattened half sphere."""
    around, up = 9, 4
    size = rng.uniform(1.0, 4.5) * np.array([1.0, rng.uniform(0.6, 1.0), rng.uniform(0.4, 0.8)])
    angle = np.linspace(0, 2 * np.pi, around)
    height = np.linspace(-0.2, 1, up)
    ring = np.sqrt(1 - np.clip(height, 0, 1) ** 2)
    circle = ring[:, None] * np.cos(angle), ring[:, None] * np.sin(angle)
    unit = np.stack(np.broadcast_arrays(*circle, height[:, None]), -1)
    rough = rng.uniform(0.85, 1.15, (up, around, 1))
    rough[:, -1] = rough[:, 0]
    points = unit * rough * size + foot
    normals = unit / size
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    grey = np.array([0.62, 0.56, 0.45]) * rng.uniform(0.8, 1.15)
    return grid_mesh("rock", points, normals, grey, np.stack(np.meshgrid(angle, height), -1))
