"""Textures drawn from random numbers; none is copied from another work.

Each is uint8 [H, W, 3] or [H, W, 4], RGB(A), with powers of two as sizes. The renderer multiplies
the mesh's colours by it. Its mean is known (`MEANS`), and colours are divided by that mean.
"""

from dataclasses import replace
from functools import lru_cache, reduce

import cv2
import numpy as np
from scipy.spatial import cKDTree

from zoo.simulator.scenery.mesh import Mesh

SIZE = 256
# Mean grey, 0..1; a low mean leaves room for grain, a high one for bright light.
MEANS = {"asphalt": 0.6, "cobbles": 0.7, "rock": 0.75, "ground": 0.8, "concrete": 0.95}
MEANS |= {"worn": 0.6, "leaves": 0.7}
# The original's asphalt is lighter at flat angles of view, 122 of 255 at the bonnet and 150 at 9 m.
# Therefore each halving of the texture is lighter than the last.
BRIGHTER_PER_HALVING = {"asphalt": 0.10}
MOST_BRIGHTER = 0.26
PAVED = ("asphalt", "cobbles", "worn", "plain")  # materials that get darker when wet


@lru_cache(maxsize=2)
def make_textures(seed: int) -> dict[str, np.ndarray]:
    """Return every texture by its material; the seed changes grain, not mean colour.

    The last ones are kept for further worlds of the process, since drawing them takes 0.05 s.
    """
    rng = np.random.default_rng(seed)
    textures = {
        "asphalt": _grain("asphalt", rng, ((0.6, 0.17), (1.6, 0.02), (10, 0.008), (40, 0.012))),
        "concrete": _grain("concrete", rng, ((1.0, 0.015), (12, 0.015), (40, 0.02))),
        "ground": _grain("ground", rng, ((1.2, 0.04), (6, 0.06), (25, 0.05))),
        "rock": _rock(rng),
        "cobbles": _cobbles(rng),
        "stripes": _stripes(),
        "plain": np.full((8, 8, 3), 255, np.uint8),
        "plants": _plants(rng),
        "worn": _worn(rng),
        "leaves": _leaves(rng),
        "hazard": _hazard(),
    }
    for pixels in textures.values():
        pixels.flags.writeable = False  # worlds share them
    return textures


def halvings(name: str, pixels: np.ndarray) -> list[np.ndarray]:
    """Return the texture and its halvings down to 1 x 1 (mipmaps), for growing distances."""
    step = BRIGHTER_PER_HALVING.get(name, 0.0)
    levels = [pixels]
    while max(levels[-1].shape[:2]) > 1:
        height, width = (max(size // 2, 1) for size in levels[-1].shape[:2])
        levels.append(cv2.resize(levels[-1], (width, height), interpolation=cv2.INTER_AREA))
    return [
        np.clip(level * (1 + min(step * number, MOST_BRIGHTER)), 0, 255).astype(np.uint8)
        for number, level in enumerate(levels)
    ]


def untextured(mesh: Mesh) -> Mesh:
    """Return a mesh without texture, in the mean colours that it has from afar."""
    colours = mesh.colours * (1 + MOST_BRIGHTER * (mesh.material in BRIGHTER_PER_HALVING))
    if mesh.material == "stripes":
        colours = colours * _stripes().mean((0, 1)) / 255
    return replace(mesh, material="plain" if mesh.material in PAVED else "bare", colours=colours)


def _noise(rng: np.random.Generator, size: float) -> np.ndarray:
    """Return seamless noise float [SIZE, SIZE], mean 0, deviation 1, blurred by `size` pixels."""
    white = rng.normal(size=(SIZE, SIZE))
    spectrum = np.fft.rfft2(white)
    y = np.fft.fftfreq(SIZE)[:, None]
    x = np.fft.rfftfreq(SIZE)[None]
    smooth = np.fft.irfft2(spectrum * np.exp(-2 * (np.pi * size) ** 2 * (x**2 + y**2)), white.shape)
    smooth -= smooth.mean()
    return smooth / smooth.std()


def _to_texture(name: str, values: np.ndarray) -> np.ndarray:
    """Return uint8 RGB of grey or RGB floats, shifted to the material's mean."""
    values = values + MEANS[name] - values.mean((0, 1))
    if values.ndim == 2:
        values = np.repeat(values[..., None], 3, 2)
    return (np.clip(values, 0, 1) * 255).astype(np.uint8)


def _grain(
    name: str, rng: np.random.Generator, octaves: tuple[tuple[float, float], ...]
) -> np.ndarray:
    noises = (strength * _noise(rng, size) for size, strength in octaves)
    return _to_texture(name, reduce(np.add, noises))


def _rock(rng: np.random.Generator) -> np.ndarray:
    """Return streaks downhill, as on the original's rock faces."""
    fine, coarse = _noise(rng, 2), _noise(rng, 9)
    streaks = cv2.blur(_noise(rng, 1.5), (1, 41), borderType=cv2.BORDER_REFLECT)
    return _to_texture("rock", 0.05 * fine + 0.07 * coarse + 0.35 * streaks)


def _cobbles(rng: np.random.Generator) -> np.ndarray:
    """Return uneven paving stones with joints: a Voronoi diagram of scattered points."""
    rows, columns = 8, 6
    y, x = np.mgrid[0:rows, 0:columns].astype(float)
    x[::2] += 0.5
    centres = np.stack([y + 0.5, x + 0.25], -1).reshape(-1, 2)
    centres += rng.uniform(-0.22, 0.22, centres.shape)
    tones = rng.uniform(-0.14, 0.06, len(centres))
    wrapped = np.concatenate(
        [centres + (dy * rows, dx * columns) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    )
    grid = (np.mgrid[0:SIZE, 0:SIZE].reshape(2, -1).T + 0.5) / SIZE * (rows, columns)
    apart, nearest = cKDTree(wrapped).query(grid, k=2, p=1)
    stone = tones[nearest[:, 0] % len(tones)]
    grey = np.where(apart[:, 1] - apart[:, 0] < 0.16, 0.20, stone).reshape(SIZE, SIZE)
    return _to_texture("cobbles", cv2.GaussianBlur(grey, (5, 5), 0) + 0.05 * _noise(rng, 1))


def _stripes() -> np.ndarray:
    """Return alternating red and white along the road."""
    stripes = np.empty((32, 64, 3))
    stripes[:, :32] = (0.95, 0.47, 0.42)
    stripes[:, 32:] = (1.0, 0.95, 0.90)
    return (stripes * 255).astype(np.uint8)


def _worn(rng: np.random.Generator) -> np.ndarray:
    """Return tarmac of 8 m, whose middle is at the border, with four winding tyre marks."""
    across, along = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    grey = 0.10 * _noise(rng, 0.6) + 0.03 * _noise(rng, 5) + 0.03 * _noise(rng, 25)
    for middle in (0.14, 0.34, 0.66, 0.86):
        wind = 0.015 * np.sin(2 * np.pi * (along + middle)) + middle
        grey -= 0.16 * np.exp(-(((across - wind) / 0.028) ** 2))
    return _to_texture("worn", grey)


def _leaves(rng: np.random.Generator) -> np.ndarray:
    """Return fallen leaves of many tones, one upon the other."""
    leaves = np.full((SIZE, SIZE, 3), 0.5)
    for _ in range(2600):
        x, y, turn = (int(number) for number in rng.integers(0, (SIZE, SIZE, 180)))
        tone = rng.uniform(0.5, 0.9)
        colour = (tone, tone * rng.uniform(0.82, 1.05), tone * rng.uniform(0.7, 1.1))
        for corner in ((x, y), (x - SIZE, y), (x, y - SIZE)):  # seamless
            cv2.ellipse(leaves, corner, (6, 3), turn, 0, 360, colour, -1)
    return _to_texture("leaves", leaves)


def _hazard() -> np.ndarray:
    """Return a barrier's side: concrete with slanted yellow and black stripes."""
    y, x = np.mgrid[0:64, 0:128]
    side = np.full((64, 128, 3), 0.52)
    striped = (y > 14) & (y < 50)
    yellow = (x + y) % 32 < 16
    side[striped & yellow], side[striped & ~yellow] = (0.92, 0.72, 0.05), (0.05, 0.05, 0.05)
    return (side * 255).astype(np.uint8)


SIGNS = ("lamp", "chevron", "road_closed")
PLANTS = (
    *("pine", "tall_pine", "round_tree", "bush", "reeds", "pylon", "tyres"),
    *("red_tree", "brown_tree", *SIGNS),
)
TILES = 16  # of the atlas, whose width must be a power of two
# Height of the crown's lower end, half its width, and colour.
TREES = {
    "pine": (96, 19, (128, 130, 72)),
    "tall_pine": (66, 15, (128, 130, 72)),
    "round_tree": (92, 25, (128, 130, 72)),
    "red_tree": (90, 25, (196, 74, 40)),
    "brown_tree": (88, 22, (158, 104, 56)),
}


def _plants(rng: np.random.Generator) -> np.ndarray:
    """Return an atlas uint8 [128, 1024, 4]: `PLANTS` from left to right, on the lower edge."""
    atlas = np.zeros((128, 64 * TILES, 4), np.uint8)
    for number, name in enumerate(PLANTS):
        tile = atlas[:, 64 * number : 64 * (number + 1)]
        if name in TREES:
            _draw_tree(tile, rng, name)
        elif name in ("bush", "reeds"):
            _draw_bush(tile, rng, name)
        else:
            _draw_object(tile, name)
    return atlas


def _draw_tree(tile: np.ndarray, rng: np.random.Generator, kind: str) -> None:
    lowest, widest, crown = TREES[kind]
    cv2.rectangle(tile, (30, 12), (33, 127), (105, 82, 58, 255), -1)
    for _ in range(90):
        height = rng.uniform(6, lowest)
        reach = widest * np.sin(np.pi * np.clip((height + 8) / (lowest + 22), 0, 1)) ** 0.7
        x, size = 32 + rng.uniform(-1, 1) * reach, rng.uniform(3, 7)
        tone = rng.uniform(0.3, 0.9) * (1.0 if x < 34 else 0.7)
        colour = (*(part * tone for part in crown), 255)
        cv2.ellipse(
            tile, (int(x), int(height)), (int(size), int(size * 0.7)), 0, 0, 360, colour, -1
        )


def _draw_bush(tile: np.ndarray, rng: np.random.Generator, kind: str) -> None:
    top = 55 if kind == "bush" else 30
    for _ in range(260):
        x = rng.integers(1, 63)
        height = rng.uniform(0.35, 1) * (128 - top) * (1 - ((x - 32) / 38) ** 4)
        tone = rng.uniform(0.3, 0.75)
        start = 127 - rng.uniform(0, 0.5) * height
        colour = (120 * tone, 140 * tone, 62 * tone, 255)
        lean = int(x + rng.integers(-3, 4))
        cv2.line(tile, (int(x), int(start)), (lean, int(127 - height)), colour, 2)


def _draw_object(tile: np.ndarray, kind: str) -> None:
    dark = (70, 72, 76, 255)
    if kind == "pylon":
        for height in range(0, 127, 9):
            wide, below = 3 + 14 * height / 127, 3 + 14 * (height + 9) / 127
            for side in (-1, 1):
                end = (int(32 - side * below), height + 9)
                cv2.line(tile, (int(32 + side * wide), height), end, dark, 1)
        cv2.line(tile, (29, 0), (15, 127), dark, 1)
        cv2.line(tile, (35, 0), (49, 127), dark, 1)
        for height in (14, 34):
            cv2.line(tile, (10, height), (54, height), dark, 2)
    elif kind == "lamp":  # its arm points to the left
        cv2.line(tile, (32, 6), (32, 127), dark, 3)
        cv2.line(tile, (32, 6), (8, 3), dark, 2)
        cv2.rectangle(tile, (2, 2), (14, 6), (226, 222, 200, 255), -1)
    elif kind in SIGNS:
        cv2.line(tile, (32, 64), (32, 127), dark, 4)
        pale = kind == "road_closed"
        cv2.rectangle(tile, (1, 1), (62, 62), (225, 225, 220, 255) if pale else (8, 8, 8, 255), -1)
        if pale:
            cv2.rectangle(tile, (6, 22), (57, 42), (190, 30, 25, 255), -1)
        else:
            arrow = np.array([[6, 32], [36, 6], [56, 6], [26, 32], [56, 58], [36, 58]])
            cv2.fillPoly(tile, [arrow], (240, 190, 20, 255))
    else:
        cv2.rectangle(tile, (2, 70), (61, 127), (52, 48, 44, 255), -1)
        for height in (82, 97, 112):
            cv2.line(tile, (2, height), (61, height), (120, 104, 88, 255), 3)
