"""The command `drivezoo simulator serve`: the embedded world for Donkeycar clients."""

from zoo.base.command import command
from zoo.extras.donkey.serve_options import ServeOptions


@command(name="simulator serve", parts=False)
def serve(*, options: ServeOptions) -> None:
    """Serve the embedded world to Donkeycar clients, such as gym-donkeycar.

    It listens as the Donkeycar simulator does, without a display or a GPU; Ctrl-C ends it.

    Args:
        options: see `ServeOptions`.
    """
    from zoo.extras.donkey.donkey_server import serve_clients  # slow import: SciPy

    serve_clients(options)
