"""Print the digest of a drive of each checkpoint: `python -m tests.zoo.driving.driven_digests`."""

import json
import sys

from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.results.suite_drives import drive_digest

SCENARIO = Scenario(track="udacity_jungle", laps=50 / 1_465, seed=2, weather="random")

if __name__ == "__main__":
    drives = all_drives(sys.argv[1:], [SCENARIO] * len(sys.argv[1:]), renderer="software")
    print(json.dumps([(drive_digest(drive), len(drive), drive.tied) for drive in drives]))
