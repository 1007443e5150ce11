"""`drivezoo replay CKPT RECORDING [key=value ...]`: score a checkpoint on any recording.

Needs no simulator: warps the recorded frames to the position that the network steers to.
"""

import sys

from zoo.cli.command import CHECKPOINT, Command
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__, {"CKPT": CHECKPOINT, "RECORDING": "recording's folder"})


def replay(arguments: list[str]) -> None:
    """Read the arguments and replay."""
    from rich.console import Console

    from zoo.evaluate.replay_score import ReplayOptions, replay_and_print

    (checkpoint, recording), options = COMMAND.read(arguments, ReplayOptions)
    replay_and_print(checkpoint, recording, options, Console(emoji=False))


if __name__ == "__main__":
    sys.exit(run_command("zoo.replay", replay, sys.argv[1:]))
