"""Print the digest of a drive of each checkpoint: `python -m tests.zoo.driving.driven_digests`."""

import json
import sys
from collections.abc import Sequence

from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.results.suite_drives import drive_digest

SCENARIO = Scenario(track="udacity_jungle", laps=50 / 1_465, seed=2, weather="random")


def driven_digests(files: Sequence[str]) -> list[list]:
    """Return digest, frames and `tied` of a drive of each checkpoint."""
    drives = all_drives(files, [SCENARIO] * len(files), renderer="software")
    return [[drive_digest(drive), len(drive), drive.tied] for drive in drives]


if __name__ == "__main__":
    print(json.dumps(driven_digests(sys.argv[1:])))
