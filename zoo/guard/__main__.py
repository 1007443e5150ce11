"""`drivezoo guard CKPT [key=value ...]`: measure warnings before failures, and fit a guard.

Drives nominal roads, levels of fog, rain and light, and degraded networks; counts how well several
scores of the frames warn 1, 2 and 3 s before a failure. Writes guard.pt for `guard=` of drivezoo
drive and drivezoo evaluate, which slows the car down, and guard.json, guard.html and guard.png.
"""

import sys

from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.cli.command import CHECKPOINT, Command
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__, {"CKPT": CHECKPOINT})

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


def command(arguments: list[str]) -> None:
    """Read the arguments, drive, and write figures and guard."""
    (checkpoint,), rest = COMMAND.split(arguments)
    from rich.console import Console

    from zoo.cli.command_config import read_keys

    keys = read_keys(COMMAND.name, rest)
    with loading():
        from zoo.cli.command_config import check_options
        from zoo.guard.guard_options import GuardOptions

        options = check_options(GuardOptions, keys)
        checkpoint = str(find_checkpoint(checkpoint))
        from zoo.guard.guard_run import run_guard
        from zoo.worlds.run_drives import one_thread
    with one_thread():
        run_guard(checkpoint, options, Console(emoji=False))


if __name__ == "__main__":
    sys.exit(run_command("zoo.guard", command, sys.argv[1:]))
