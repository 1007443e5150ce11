"""Short tracks for tests: a loop of 440 m, driven counter-clockwise, and an open road of 214 m."""

import pytest

from zoo.base.errors import InputError
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


def refusal(path: str) -> str:
    """Return the one line, which begins with the path, of a track that is refused."""
    with pytest.raises(InputError) as error:
        read_track(path)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{path}: ")
    return str(error.value)
