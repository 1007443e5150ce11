"""`drivezoo search CKPT [key=value ...]`: find roads and days on which a checkpoint fails.

Drives roads of a family until their first intervention, draws a map of the failures over two
features, and writes the mildest failing road as a track's file that replays the drive.
"""

import sys

from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.cli.command import CHECKPOINT, Command
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__, {"CKPT": CHECKPOINT})

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


def command(arguments: list[str]) -> None:
    """Read the arguments and search."""
    (checkpoint,), rest = COMMAND.split(arguments)
    from rich.console import Console

    from zoo.cli.command_config import read_options
    from zoo.search.search_options import SearchOptions

    options = read_options(COMMAND.name, SearchOptions, rest)
    checkpoint = str(find_checkpoint(checkpoint))
    with loading():
        from zoo.search.search_report import search_and_report
    search_and_report(checkpoint, options, Console(emoji=False))


if __name__ == "__main__":
    sys.exit(run_command("zoo.search", command, sys.argv[1:]))
