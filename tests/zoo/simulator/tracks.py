"""Short tracks for tests: a loop of 440 m, driven counter-clockwise, and an open road of 214 m."""

from pathlib import Path

import numpy as np
import yaml

from tests import refusals
from zoo.simulator.track import Track
from zoo.simulator.track_content import make_track
from zoo.simulator.track_file import read_track

LOOP = [[0, 0, 0], [100, 0, 0], [140, 40, 0], [100, 80, 0], [0, 80, 0], [-40, 40, 0]]
OPEN = [
    {"straight": 60},
    {"left": 60, "radius": 30, "climb": 2},
    {"straight": 30},
    {"right": 60, "radius": 30},
    {"straight": 61, "climb": -1},
]


def loop(**content) -> Track:
    return make_track("loop", {"points": LOOP, "verge": {"left": "dirt"}, **content})


def open_road(**content) -> Track:
    return make_track("road", {"segments": OPEN, "closed": False, **content})


def right_of(track: Track, distance: float | np.ndarray, metres: float | np.ndarray) -> np.ndarray:
    """Return places float [..., 3] some metres to the right of the centreline."""
    heading = np.asarray(track.heading_at(distance))
    right = np.stack([np.sin(heading), -np.cos(heading), np.zeros_like(heading)], -1)
    return track.at(distance) + np.asarray(metres)[..., None] * right


def write_track(folder: Path, rows: str | None = None, **content) -> str:
    """Write a track and the rows of its survey, if any; return the track's path."""
    if rows is not None:
        (folder / "mine.csv").write_text(rows)
        content = {"survey": "mine.csv", **content}
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


def refusal(path: str) -> str:
    """Return the one line, which begins with the path, of a track that is refused."""
    line = refusals.refusal(read_track, path)
    assert line.startswith(f"{path}: ")
    return line
