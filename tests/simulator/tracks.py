"""A short track for tests: 440 m, level, driven counter-clockwise."""

from simulator.track import Track
from simulator.track_file import make_track

LOOP = [[0, 0, 0], [100, 0, 0], [140, 40, 0], [100, 80, 0], [0, 80, 0], [-40, 40, 0]]


def loop(**content) -> Track:
    return make_track("loop", {"points": LOOP, "verge": {"left": "dirt"}, **content})
