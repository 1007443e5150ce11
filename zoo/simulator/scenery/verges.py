"""The profile of the road and its verges: bands of one material across the road, and their room.

Widths were measured on the original's frames of a straight, projected to a view from above: 6.4 m
between the inner yellow lines; a dark strip and a second line; about 1.4 m of paved shoulder; then
a concrete bank of about 2 m, pale in the sun and blue-grey in the shade.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from zoo.simulator.track import LEAVES_M, Surroundings, Track

BANK = 0.9  # slope for the light: the original's bank is cream in the sun, blue-grey in shade
VERGE_END_M = 14.0  # from the centreline; the ground's mesh continues from there

YELLOW, GUTTER = (0.66, 0.62, 0.36), (0.23, 0.22, 0.17)
ASPHALT, SHOULDER = (0.356, 0.355, 0.366), (0.40, 0.40, 0.40)
COBBLES, CONCRETE = (0.49, 0.43, 0.435), (0.95, 0.92, 0.77)
SAND, PINK_SAND = (0.55, 0.40, 0.26), (0.68, 0.50, 0.40)
GRASS, ROCK, WALL = (0.55, 0.49, 0.27), (0.60, 0.55, 0.46), (0.04, 0.035, 0.03)
FOREST, WHITE = (0.32, 0.35, 0.19), (0.75, 0.75, 0.72)
WORN, LEAVES = (0.20, 0.205, 0.225), (0.80, 0.53, 0.05)
LITTER, BLACK_ROCK = (0.34, 0.21, 0.12), (0.085, 0.08, 0.085)
# By `ground` of the surroundings.
SOILS = {"sand": SAND, "grass": GRASS, "forest": FOREST, "autumn": LITTER}
# Material, colour and repeat.
PAVINGS = {
    "asphalt": ("asphalt", ASPHALT, 4.0),
    "cobbles": ("cobbles", COBBLES, 2.0),
    "worn": ("worn", WORN, 8.0),
}
STRIDE = 2  # only every second sample is compared with the others
LOCAL_M = 3.0  # samples nearer than this to each other do not limit each other's verges
HIGH_M = 10.0  # height of a bridge above which every kind of verge passes below it
LEAST_M = 1.1  # of verge outside the road's edge, enough for a wall
CLEAR_M = 1.0  # outside a road's edge, in which no verge of another part may lie
TRIED_M = np.arange(3.0, VERGE_END_M, 1.0)  # distances from the centreline


@dataclass(frozen=True)
class Band:
    """A strip of one material: metres from the road's edge, heights above the road."""

    start: float | np.ndarray  # an array has a value for each point along the road
    end: float | np.ndarray
    rise_start: float
    rise_end: float
    material: str
    colour: tuple[float, float, float]
    repeat: float = 4.0  # metres that one texture covers
    steep: float | None = None  # rise per metre assumed for its light; None for the real one


def verge_bands(
    kind: str,
    shoulder: float,
    room: float | np.ndarray,
    around: Surroundings,
    paving: str = "asphalt",
) -> list[Band]:
    """Return the bands outside the road's edge for a kind of verge, up to `room` metres."""
    high = around.kerb_height
    paved_by = PAVINGS[paving]
    # The bridge's walls are nearly black in the original; walls of a mountain road are stone.
    wall = ("plain", WALL) if paving == "cobbles" else ("rock", ROCK, 3.0)
    soil = SOILS[around.ground]
    grass = soil if around.ground in ("forest", "autumn") else GRASS
    litter = "leaves" if around.ground == "autumn" else "ground"
    leaves = Band(0.0, LEAVES_M, 0, 0, "leaves", LEAVES, 2.5)
    line = [
        Band(0.0, 0.10, 0, 0, "plain", YELLOW),
        Band(0.10, 0.42, 0, 0, "plain", GUTTER),
        Band(0.42, 0.50, 0, 0, "plain", YELLOW),
    ]
    edge = Band(0.0, 0.12, 0, 0, "plain", WHITE)
    paved, striped = 0.5 + shoulder, 0.5 + around.stripes_width
    outer = striped + around.kerb_width - 0.1
    bands = {
        "kerb": [
            *line,
            Band(0.5, paved, 0, 0, "asphalt", SHOULDER),
            Band(paved, paved + around.kerb_width, 0, high, "concrete", CONCRETE, steep=BANK),
            Band(paved + around.kerb_width, room, high, 0.2, "ground", soil),
        ],
        "stripes": [
            *line,
            Band(0.5, striped, 0, 0.12, "stripes", (0.92, 0.92, 0.95), 1.1),
            Band(striped, outer, 0.12, high, "concrete", CONCRETE, steep=BANK),
            Band(outer, room, high, 0.2, "ground", soil),
        ],
        "dirt": [
            Band(0.0, 1.2, 0, 0.05, "ground", PINK_SAND, steep=0.0),
            Band(1.2, room, 0.05, 0.2, "ground", FOREST if soil == FOREST else SAND, 6.0),
        ],
        "wall": [
            Band(0.0, 0.7, 0, 0, *paved_by),
            Band(0.7, 0.72, 0, 0.75, *wall),
            Band(0.72, 1.0, 0.75, 0.75, *wall),
            Band(1.0, 1.02, 0.75, -4.0, *wall),
        ],
        "rock": [
            edge,
            Band(0.12, 0.9, 0, 0.1, "ground", soil),
            Band(0.9, 1.9, 0.1, 3.2, "rock", ROCK, 6.0),
            Band(1.9, 3.4, 3.2, 5.0, "rock", ROCK, 6.0),
            Band(3.4, room, 5.0, 6.0, "ground", grass, 8.0),
        ],
        "drop": [
            edge,
            Band(0.12, 0.9, 0, 0, "ground", soil),
            Band(0.9, 1.3, 0, 0.35, "concrete", CONCRETE),
            Band(1.3, 3.5, 0.35, -2.0, "ground", grass, 6.0),
            Band(3.5, room, -2.0, -5.0, "ground", grass, 6.0),
        ],
        "paved": [
            *line,
            Band(0.5, paved + 1.4, 0, 0.1, "asphalt", SHOULDER),
            Band(paved + 1.4, room, 0.1, 0.25, "ground", grass, 6.0),
        ],
        "leaves": [leaves, Band(LEAVES_M, room, 0, 0.2, litter, soil, 5.0)],
        "cliff": [
            leaves,
            Band(LEAVES_M, LEAVES_M + 0.15, 0, 5.0, "rock", BLACK_ROCK, 6.0),
            Band(LEAVES_M + 0.15, 3.5, 5.0, 6.5, "rock", BLACK_ROCK, 6.0),
            Band(3.5, room, 6.5, 2.0, "rock", BLACK_ROCK, 6.0),
        ],
        "barriers": [
            leaves,
            Band(LEAVES_M, 3.2, 0, 0, litter, soil, 5.0),
            Band(3.2, 5.5, 0, -2.0, litter, soil, 5.0),
            Band(5.5, room, -2.0, -5.0, litter, soil, 5.0),
        ],
        "closed": [leaves, Band(LEAVES_M, room, 0, 0.1, "asphalt", WORN)],
    }
    return bands[kind]


def carriageway(half: np.ndarray, paving: str, centre_line: bool) -> list[Band]:
    """Return the bands between the road's edges, from left to right."""
    paved_by = PAVINGS[paving]
    if not centre_line:
        return [Band(-half, half, 0, 0, *paved_by)]
    return [
        Band(-half, -0.08, 0, 0, *paved_by),
        Band(-0.08, 0.08, 0, 0, "plain", YELLOW),
        Band(0.08, half, 0, 0, *paved_by),
    ]


def rise_at(bands: list[Band], away: np.ndarray) -> np.ndarray:
    """Return a verge's height above the road in metres, `away` metres outside the road's edge."""
    places = [float(np.max(place)) for band in bands for place in (band.start, band.end)]
    rises = [rise for band in bands for rise in (band.rise_start, band.rise_end)]
    return np.interp(away, places, rises)


def verge_room(track: Track) -> np.ndarray | None:
    """Return how far verges may reach from the centreline in metres, float [2, N], left and right.

    Verges of parts near each other meet halfway between them. None where no verge reaches another
    part of the road. Bridges leave the whole room to the road below.
    """
    ground = ~track.bridge
    xy, half = track.xyz[:, :2], track.widths / 2
    right, tree = track.rightwards, cKDTree(xy[ground])
    if not any(_covers(track, tree, half, side) for side in (-1, 1)):
        return None
    room = np.full((2, len(xy)), VERGE_END_M)
    pairs = STRIDE * cKDTree(xy[::STRIDE]).query_pairs(2 * VERGE_END_M, output_type="ndarray")
    for here, other in (pairs.T, pairs.T[::-1]):
        here, other = here[ground[other]], other[ground[other]]
        apart = xy[other] - xy[here]
        square = (apart**2).sum(1)
        towards = (apart * right[here]).sum(1)
        for number, side in enumerate((-1, 1)):
            facing = (towards * side > 0.02) & (square > LOCAL_M**2)
            # A circle through both points that touches the road here has its centre halfway.
            halfway = square[facing] / (2 * side * towards[facing])
            np.minimum.at(room[number], here[facing], halfway)
    room = np.repeat(room[:, ::STRIDE], STRIDE, axis=1)[:, : len(xy)]
    room[:, track.bridge] = VERGE_END_M  # nothing stands beside a bridge
    _leave_room_for_bridges(track, room)
    return np.maximum(room, half + LEAST_M)


def _leave_room_for_bridges(track: Track, room: np.ndarray) -> None:
    """Shorten verges below low bridges, because some rise by several metres."""
    deck = np.flatnonzero(track.bridge)
    if not len(deck):
        return
    half = track.widths / 2
    apart, near = cKDTree(track.xyz[deck, :2]).query(track.xyz[:, :2])
    above = track.xyz[deck[near], 2] - track.xyz[:, 2]
    low = ~track.bridge & (apart < half[deck[near]] + VERGE_END_M) & (above > 1) & (above < HIGH_M)
    room[:, low] = np.minimum(room[:, low], half[low] + LEAST_M)


def _covers(track: Track, tree: cKDTree, half: np.ndarray, side: int) -> bool:
    """Return whether a verge of full width lies on another part of the road."""
    reach = inner_reach(track.curvature, side)
    for away in TRIED_M:
        far = np.minimum(away + half, reach)
        apart, _ = tree.query(track.xyz[:, :2] + far[:, None] * (side * track.rightwards))
        if (apart < np.minimum(half + CLEAR_M, far - 1.5))[~track.bridge].any():
            return True
    return False


def inner_reach(curvature: np.ndarray, side: int) -> np.ndarray:
    """Return the metres from the centreline at which a verge ends inside of bends, else inf.

    A wide verge would fold over itself there, so it ends before the bend's centre.
    """
    bend = -curvature * side
    return np.where(bend > 0, 0.85 / np.maximum(bend, 1e-9), np.inf)


def smooth(x: np.ndarray) -> np.ndarray:
    """Return 0 below 0, 1 above 1, and a smooth step between (Perlin's smoothstep)."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)
