"""A year's suite with secret roads, whose hash is published before anybody drives it."""

import secrets
from pathlib import Path

from rich.console import Console

from zoo.base.bounded_files import hash_file, read_yaml
from zoo.base.errors import InputError
from zoo.base.file_text import yaml_text
from zoo.base.whole_file import write_whole
from zoo.results.suite import read_suite, suite_path
from zoo.results.suite_drives import drive_suite, find_drivers
from zoo.runs.record_fields import MOST_WHOLE


def secret_suite(name: str = "v2-2027") -> None:
    """Write NAME.yaml and NAME_bends.yaml, v2 on secret roads, and print their SHA-256.

    `secret_suite [NAME]`. A random seed draws the roads, and the family of those axes whose levels
    do not differ in it has ranges that nobody knows. Both are drawn until the expert completes
    every road.

    Raises:
        InputError: a file exists.
    """
    path, own, console = Path(f"{name}.yaml"), Path(f"{name}_bends.yaml"), Console()
    if exists := [one for one in (path, own) if one.exists()]:
        raise InputError(f"{exists[0]}: exists; a secret is not drawn twice")
    axes = read_yaml(suite_path("v2"))["axes"]
    for levels in axes.values():
        if len({one["family"] for one in levels}) == 1:
            levels[:] = [one | {"family": str(own)} for one in levels]
    while True:
        content = {"like": "v2", "name": name, "seed": secrets.randbelow(MOST_WHOLE), "axes": axes}
        write_whole(own, yaml_text(secret_family()))
        write_whole(path, yaml_text(content))
        suite = read_suite(str(path))
        drivers = find_drivers(["expert"], suite)
        jobs = [(0, drive) for drive in suite.drives]
        if all(one.is_clean for one in drive_suite(drivers, jobs, None, 0, console)):
            break
    for one in (path, own):
        print(f"{one}: SHA-256 {hash_file(one)}")
    print(f"roads {suite.roads}")


def secret_family() -> dict:
    """Return a family with the radii of `bends_2`, and other bends, slopes and surroundings."""
    draw = secrets.SystemRandom().uniform
    ends = {
        "straight": (5, 20, 20, 60),
        "degrees": (10, 30, 90, 170),
        "grade": (-0.1, -0.02, 0.02, 0.1),
        "shoulder": (0.2, 0.6, 0.6, 2.0),
    }
    verges = ("paved", "dirt", "kerb", "stripes", "rock")
    return {
        "like": "bends_1",
        "radius": [28, 60],
        "straights": round(draw(0, 0.6), 2),
        **{key: [round(draw(*own[:2]), 2), round(draw(*own[2:]), 2)] for key, own in ends.items()},
        "verges": {kind: round(draw(0, 3), 2) for kind in verges},
    }
