"""The room that parts of the road leave each other for their verges."""

import numpy as np
from scipy.spatial import cKDTree

from simulator.scenery.bands import VERGE_END_M
from simulator.track import Track

LOCAL_M = 3.0  # samples nearer than this to each other do not limit each other's verges
HIGH_M = 10.0  # height of a bridge above which every kind of verge passes below it
LEAST_M = 1.1  # of verge outside the road's edge, enough for a wall
CLEAR_M = 1.0  # outside a road's edge, in which no verge of another part may lie
TRIED_M = np.arange(3.0, VERGE_END_M, 1.0)  # distances from the centreline


def verge_room(track: Track) -> np.ndarray | None:
    """Return how far verges may reach from the centreline in metres, float [2, N], left and right.

    Verges of parts near each other meet halfway between them. None where no verge reaches another
    part of the road. Bridges leave the whole room to the road below.
    """
    ground = ~track.bridge
    xy, half = track.xyz[:, :2], track.widths / 2
    right = np.stack([np.sin(track.heading), -np.cos(track.heading)], -1)
    tree = cKDTree(xy[ground])
    if not any(_covers(track, tree, half, side * right, side) for side in (-1, 1)):
        return None
    room = np.full((2, len(xy)), VERGE_END_M)
    pairs = cKDTree(xy).query_pairs(2 * VERGE_END_M, output_type="ndarray")
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


def _covers(track: Track, tree: cKDTree, half: np.ndarray, outwards: np.ndarray, side: int) -> bool:
    """Return whether a verge of full width lies on another part of the road."""
    bend = -track.curvature * side
    reach = np.where(bend > 0, 0.85 / np.maximum(bend, 1e-9), np.inf)
    for away in TRIED_M:
        far = np.minimum(away + half, reach)
        points = track.xyz[:, :2] + far[:, None] * outwards
        apart, _ = tree.query(points)
        least = half + CLEAR_M
        if (apart < np.minimum(least, far - 1.5))[~track.bridge].any():
            return True
    return False
