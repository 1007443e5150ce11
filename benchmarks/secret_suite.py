"""A year's suite with secret roads, whose hash is published before anybody drives it."""

import secrets
from pathlib import Path

from rich.console import Console

from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError
from zoo.base.whole_file import write_whole
from zoo.benchmark.drives import drive_suite, find_drivers
from zoo.benchmark.suite import read_suite
from zoo.runs.record_fields import MOST_WHOLE


def secret_suite(name: str = "v2-2027") -> None:
    """Write NAME.yaml, v2 on roads of a random seed, and print its SHA-256: `secret_suite [NAME]`.

    Seeds are drawn until the expert completes every road.

    Raises:
        InputError: the file exists.
    """
    path, console = Path(f"{name}.yaml"), Console()
    if path.exists():
        raise InputError(f"{path}: exists; a secret is not drawn twice")
    while True:
        seed = secrets.randbelow(MOST_WHOLE)
        write_whole(path, f"like: v2\nname: {name}\nseed: {seed}\n")
        suite = read_suite(str(path))
        drivers = find_drivers(["expert"], suite)
        jobs = [(0, drive) for drive in suite.drives]
        if all(one.is_clean for one in drive_suite(drivers, jobs, None, 0, console)):
            break
    print(f"{path}: SHA-256 {hash_file(path)}, roads {suite.roads}")
