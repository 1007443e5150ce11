"""`drivezoo search`: find roads and days on which a checkpoint fails."""

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.extras.research.search_options import SearchOptions

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


@command(outputs=True)
def search(ckpt: str, *, options: SearchOptions) -> dict:
    """Find roads and days on which a checkpoint fails.

    Drives roads of a family until their first intervention, draws a map of the failures over two
    features, and writes the mildest failing road as a track's file that replays the drive.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet.
        options: see `SearchOptions`.
    """
    from rich.console import Console

    checkpoint = str(find_checkpoint(ckpt))
    with loading():
        from zoo.extras.research.search_report import search_and_report
    return search_and_report(checkpoint, options, Console(emoji=False))


if __name__ == "__main__":
    search.run()
