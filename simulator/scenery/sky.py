"""The sky: a dome of colours by elevation, measured on the original's images."""

import numpy as np

from simulator.scenery.mesh import Mesh, grid_triangles

RADIUS_M = 800.0
# Elevation in degrees, and RGB 0..255 of the original's sky there (rows 0 to 57 of its images).
COLOURS = (
    (-90, (176, 200, 208)),
    (0, (176, 202, 212)),
    (3, (164, 194, 214)),
    (6, (152, 182, 214)),
    (10, (140, 171, 209)),
    (14, (125, 154, 195)),
    (18, (114, 141, 184)),
    (21, (104, 131, 175)),
    (40, (92, 118, 166)),
    (90, (80, 105, 155)),
)


def sky_mesh() -> Mesh:
    """Return a dome around the camera; its colours are not shaded."""
    elevation = np.array([one[0] for one in COLOURS], float)
    colours = np.array([one[1] for one in COLOURS], float) / 255
    steps = np.unique(np.concatenate([elevation, np.arange(-10, 30, 2), np.arange(30, 91, 15)]))
    around = np.linspace(0, 2 * np.pi, 17)
    up, turn = np.meshgrid(np.radians(steps), around, indexing="ij")
    points = RADIUS_M * np.stack(
        [np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], -1
    )
    by_step = np.stack([np.interp(steps, elevation, colours[:, c]) for c in range(3)], -1)
    count = points.size // 3
    return Mesh(
        "sky",
        points.reshape(-1, 3),
        np.tile([0.0, 0.0, 1.0], (count, 1)),
        np.repeat(by_step, len(around), 0),
        np.zeros((count, 2)),
        grid_triangles(len(steps), len(around)),
    )
