"""`drivezoo replay`: score a checkpoint on any recording."""

import sys

from zoo.cli.run_command import run_command
from zoo.evaluate.__main__ import replay

if __name__ == "__main__":
    sys.exit(run_command("zoo.replay", replay.main, sys.argv[1:]))
