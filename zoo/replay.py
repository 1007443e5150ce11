"""`python -m zoo.replay CKPT RECORDING [margin=1 out=FOLDER]`: a score on any recording."""

import sys

from zoo.cli.run_command import run_command
from zoo.evaluate.replay_score import command

if __name__ == "__main__":
    sys.exit(run_command("zoo.replay", command, sys.argv[1:]))
