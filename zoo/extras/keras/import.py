"""`drivezoo import`: make a checkpoint of a Keras network."""

from pathlib import Path

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.extras.keras.import_options import ImportOptions

# The module's name is a keyword, so no other module can import it: the code is in
# zoo.extras.keras. torch, a slow import, comes late: --help and typos answer at once.


@command(name="import", outputs=True)
def import_file(file: str, *, options: ImportOptions) -> None:
    """Make a checkpoint of a Keras network.

    Reads .h5, .json with .h5, and .keras. Runs no code of the file. With recording=FOLDER, finds
    out by trying which colour, crop and scale the network was trained with.

    Args:
        file: Keras model: a .h5, .json or .keras file.
        options: see `ImportOptions`.
    """
    from rich.console import Console

    from zoo.extras.keras.keras_file import check_exists

    check_exists(Path(file).expanduser())
    with loading():
        from zoo.extras.keras.keras_import import import_network
    import_network(file, options, Console(emoji=False))


if __name__ == "__main__":
    import_file.run()
