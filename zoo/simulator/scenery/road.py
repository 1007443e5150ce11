"""The road and its verges: bands along the centreline."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from zoo.simulator.scenery import verges
from zoo.simulator.scenery.mesh import Mesh, every, grid_mesh, join_materials, thin
from zoo.simulator.scenery.textures import PAVED, untextured
from zoo.simulator.track import Track

ALONG_M = 1.0
ACROSS = 9  # points across the carriageway, whose shadows are colours of points
# Of quality `fast`: rows of a stretch; distances in metres at which it is drawn from every n-th
# row; and by the smallest radius of its bends, where n is less. Verges have half as many rows.
STRETCH = 32
RANGES_M = ((0.0, 38.0), (38.0, 80.0), (80.0, np.inf))
TUNNEL_LIGHT, TUNNEL_DARK_M = 0.34, 9.0  # share of light, reached this far from the portal
STEPS = ((20.0, (1, 2, 4)), (80.0, (2, 4, 8)), (np.inf, (2, 8, 16)))


def road_meshes(track: Track) -> list[Mesh]:
    """Return meshes of road, lines, shoulders and verges of the whole road, one per material."""
    return join_materials([mesh for _, bands in _runs(track) for mesh, _ in bands])


def road_levels(track: Track) -> list[Mesh]:
    """Return the meshes of `road_meshes` in stretches with several levels of detail."""
    meshes: list[Mesh] = []
    stretches = (
        (along, bands, first)
        for along, bands in _runs(track)
        for first in range(0, len(along) - 1, STRETCH)
    )
    for group, (distance, bands, first) in enumerate(stretches):
        last = min(first + STRETCH, len(distance) - 1)
        bend = np.abs(track.curvature_at(distance[first : last + 1])).max()
        steps = next(steps for radius, steps in STEPS if bend >= 1 / radius)
        for (near, far), step, columns_step in zip(RANGES_M, steps, (2, 4, 8), strict=True):
            rows, beside = every(first, last, step), every(first, last, 2 * step)
            parts = [
                thin(mesh, columns, rows if mesh.material in PAVED else beside, columns_step)
                for mesh, columns in bands
            ]
            parts = [untextured(mesh) for mesh in parts] if near else parts
            meshes += [
                replace(mesh, group=group, seen_m=(near, far)) for mesh in join_materials(parts)
            ]
    return meshes


def _runs(track: Track) -> Iterator[tuple[np.ndarray, list[tuple[Mesh, int]]]]:
    """Yield the distances of each run's rows, and its bands with their number of columns."""
    room = verges.verge_room(track)
    for start, end in runs(track):
        along = points_along(start, end)
        half, middle = half_width(track, along), np.zeros(len(along))
        paving = verges.carriageway(half, paving_at(track, along), track.centre_line)
        bands = [(band_mesh(track, along, band, 1, middle, ACROSS), ACROSS) for band in paving]
        for number, side in enumerate((-1, 1)):
            most = None if room is None else room_at(track, room[number], along)
            share = taper_at(track, along, side)
            for band in bands_of_run(track, along, side):
                bands.append((band_mesh(track, along, band, side, half, most=most, share=share), 2))
        yield along, bands


def runs(track: Track) -> list[tuple[float, float]]:
    """Return the spans of distances in which paving, verges and bridges stay the same."""
    ends = {0.0, track.length}
    for stretch in track.stretches:
        ends |= {stretch.start, min(stretch.end, track.length)}
    ends |= set(track.distance[np.flatnonzero(np.diff(track.bridge)) + 1].tolist())
    return [(start, end) for start, end in pairwise(sorted(ends)) if end - start > 0.01]


def points_along(start: float, end: float, step_m: float = ALONG_M) -> np.ndarray:
    """Return distances about `step_m` apart from the start to the end of a run."""
    return np.linspace(start, end, max(round((end - start) / step_m), 1) + 1)


def half_width(track: Track, along: np.ndarray) -> np.ndarray:
    """Return the distance between centreline and edge line in metres, float [N]."""
    if (track.widths == track.width).all():  # without the rounding errors of an interpolation
        return np.full(len(along), track.width / 2)
    return track.width_at(along) / 2


def bands_of_run(track: Track, along: np.ndarray, side: int) -> list[verges.Band]:
    """Return the bands outside the edge of a run; `side` is -1 for the left and 1 for the right."""
    middle = float(along[0] + along[-1]) / 2
    kind = _kind_at(track, middle, side)
    room = verges.VERGE_END_M - half_width(track, along)
    paving = paving_at(track, along)
    bands = verges.verge_bands(kind, track.shoulder, room, track.surroundings, paving)
    # The outer face of a bridge's wall belongs to its deck.
    return bands[:-1] if track.on_bridge(middle) else bands


def taper_at(track: Track, along: np.ndarray, side: int) -> np.ndarray:
    """Return the share 0..1 of a verge's height that is drawn, float [N].

    Of a rock face or a drop it rises from 0 where the kind of verge changes. A cliff is uneven.
    """
    taper, kind = track.surroundings.taper, _kind_at(track, float(along[0] + along[-1]) / 2, side)
    if not taper or kind not in ("rock", "drop", "cliff", "barriers"):
        return np.ones(len(along))
    rough = 1 - 0.25 * (kind == "cliff") * np.sin(along / 7 + side) * np.sin(along / 2.3)
    kinds = [(start, _kind_at(track, (start + end) / 2, side)) for start, end in runs(track)]
    before = [kinds[-1] if track.closed else (0.0, ""), *kinds[:-1]]
    changes = [
        start for (start, kind), (_, last) in zip(kinds, before, strict=True) if kind != last
    ]
    changes += [] if track.closed else [track.length]
    if not changes:
        return rough
    apart = np.abs(along[:, None] - np.array(changes))
    if track.closed:
        apart = np.minimum(apart, track.length - apart)
    return verges.smooth(apart.min(1) / taper) * rough


def _kind_at(track: Track, distance: float, side: int) -> str:
    """Return the kind of verge on a side."""
    verge = track.verge_at(distance)
    return verge.left if side < 0 else verge.right


def paving_at(track: Track, along: np.ndarray) -> str:
    """Return the paving of a run."""
    stretch = track.stretch_at(float(along[0] + along[-1]) / 2)
    return stretch.paving if stretch else track.paving


def daylight(track: Track, along: np.ndarray) -> np.ndarray:
    """Return the share of light on the road, float [N]: less within tunnels."""
    light = np.ones(len(along))
    for stretch in track.stretches:
        if stretch.tunnel:
            inside = np.minimum(along - stretch.start, stretch.end - along)
            light -= (1 - TUNNEL_LIGHT) * verges.smooth(inside / TUNNEL_DARK_M)
    return light


def room_at(track: Track, room: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the values of samples float [N] at distances; the lower of two samples'."""
    count, within = len(room), along % track.length if track.closed else along
    index = np.clip(np.searchsorted(track.distance, within, "right") - 1, 0, count - 1)
    after = (index + 1) % count if track.closed else np.minimum(index + 1, count - 1)
    return np.minimum(room[index], room[after])


def rightwards(track: Track, along: np.ndarray) -> np.ndarray:
    """Return unit vectors float [N, 3] to the right of the road."""
    heading = track.heading_at(along)
    return np.stack([np.sin(heading), -np.cos(heading), np.zeros_like(heading)], -1)


def band_mesh(
    track: Track,
    along: np.ndarray,
    band: verges.Band,
    side: int,
    edge: np.ndarray,
    columns: int = 2,
    most: np.ndarray | None = None,
    share: np.ndarray | float = 1.0,
) -> Mesh:
    """Return a band's mesh.

    Args:
        track: track of the road.
        along: distances of the mesh's rows, float [N].
        band: strip to draw; its start and end are measured from `edge`, outwards.
        side: -1 for the left, 1 for the right.
        edge: metres from the centreline, float [N].
        columns: number of points across.
        most: metres from the centreline beyond which nothing is drawn, float [N].
        share: factor on heights above the road, float [N], or one for all.
    """
    start, end = (np.broadcast_to(edge, len(along)) for edge in (band.start, band.end))
    across = np.linspace(start, end, columns, axis=-1)
    rise = np.linspace(band.rise_start, band.rise_end, columns)[None]
    offset = edge[:, None] + across
    if most is not None:
        offset = np.minimum(offset, most[:, None])
        across = np.clip((offset - (edge + start)[:, None]) / (end - start)[:, None], 0, 1)
        rise = band.rise_start + (band.rise_end - band.rise_start) * across
    right = rightwards(track, along)
    reach = verges.inner_reach(track.curvature_at(along), side)
    lateral = np.minimum(offset, reach[:, None]) * side
    points = track.at(along)[:, None] + lateral[..., None] * right[:, None]
    points[..., 2] += rise * np.reshape(share, (-1, 1))
    slope = band.steep
    if slope is None:
        slope = (band.rise_end - band.rise_start) / (end - start)[:, None]
    normal = np.array([0.0, 0.0, 1.0]) - slope * side * right
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    uv = np.stack(np.broadcast_arrays(along[:, None] / band.repeat, offset / band.repeat), -1)
    if band.material == "stripes":
        uv[..., 1] = 0.5
    colours = daylight(track, along)[:, None, None] * band.colour
    return grid_mesh(band.material, points, normal[:, None], colours, uv)
