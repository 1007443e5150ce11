"""`drivezoo new KIND NAME`: write a part of your own (class, YAML file, test), or a notebook.

Writes them from a template into the current folder, which needs no checkout of drivezoo, and prints
what to type next.
"""

import sys
from pathlib import Path

from zoo.cli.closing_lines import print_next, print_written
from zoo.cli.command import Command
from zoo.cli.run_command import run_command

COMMAND = Command(
    __doc__,
    {
        "KIND": "model, augmentation, loss, callback, metric, perturbation, track, "
        "notebook (train a network and let it drive) or study (a notebook that compares networks)",
        "NAME": "name in small letters, such as my_net",
    },
)


def new(arguments: list[str]) -> None:
    """Write the files of a part, and print what to type next.

    Raises:
        InputError: see `zoo.new.part_files.write_part`.
    """
    (kind, name), _ = COMMAND.split(arguments)
    from zoo.new.part_files import write_part

    written, following = write_part(kind, name, Path())
    print_written(written)
    for command, purpose in following:
        print_next(command, purpose)


if __name__ == "__main__":
    sys.exit(run_command("zoo.new", new, sys.argv[1:]))
