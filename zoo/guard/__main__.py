"""`drivezoo guard`: measure warnings before failures, and fit a guard."""

from typing import TYPE_CHECKING

from zoo.base.command import command
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.cli.console_progress import loading
from zoo.guard.guard_options import GuardOptions

if TYPE_CHECKING:
    from zoo.guard.guard_drives import GuardResult

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


@command
def guard(ckpt: str, *, options: GuardOptions) -> "GuardResult":
    """Measure warnings before failures, and fit a guard.

    Drives nominal roads, levels of fog, rain and light, and degraded networks; counts how well
    several scores of the frames warn 1, 2 and 3 s before a failure. Writes guard.pt for `guard=` of
    drivezoo drive and drivezoo evaluate, which slows the car down, and guard.json, guard.html and
    guard.png.

    `drivezoo guard doubt CKPT...` writes a policy that knows how much it doubts; see drivezoo guard
    doubt --help.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet.
        options: see `GuardOptions`.
    """
    from rich.console import Console

    checkpoint = str(find_checkpoint(ckpt))
    with loading():
        from zoo.guard.guard_run import run_guard
        from zoo.worlds.run_drives import one_thread
    with one_thread():
        return run_guard(checkpoint, options, Console(emoji=False))


if __name__ == "__main__":
    guard.run()
