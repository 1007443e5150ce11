"""`drivezoo import FILE [key=value ...]`: make a checkpoint of a Keras network.

Reads .h5, .json with .h5, and .keras. Runs no code of the file. With recording=FOLDER, finds out by
trying which colour, crop and scale the network was trained with.
"""

import sys

from zoo.cli.command import Command
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__, {"FILE": "Keras model: a .h5, .json or .keras file"})

# The module's name is a keyword, so no other module can import it: the code is in
# zoo.input_search. torch, a slow import, comes late: --help and typos answer at once.


def import_file(arguments: list[str]) -> None:
    """Read the arguments and import."""
    from rich.console import Console

    from zoo.input_search.import_options import ImportOptions

    (file,), options = COMMAND.read(arguments, ImportOptions)
    with loading():
        from zoo.input_search.keras_import import import_network
    import_network(file, options, Console(emoji=False))


if __name__ == "__main__":
    sys.exit(run_command("zoo.import", import_file, sys.argv[1:]))
