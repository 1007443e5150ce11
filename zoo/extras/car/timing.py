"""`drivezoo timing`: the highest speed at which a network drives with measured loop times."""

from typing import TYPE_CHECKING

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.extras.car.timing_options import TimingOptions

if TYPE_CHECKING:
    from zoo.extras.car.highest_speed import Timing

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


@command(outputs=True)
def timing(ckpt: str, times: str, *, options: TimingOptions) -> "Timing":
    """Find how fast a network drives on a computer with measured loop times.

    Replays the measured delays, their jitter and lost frames in the embedded world, and searches
    the highest speed without an intervention on several roads; then again with one property
    improved at a time. Writes timing.json and timing.png.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet.
        times: loop times: a CSV file with a column latency_ms, and perhaps loop_ms; the text that
            Donkeycar's profiler prints; or the folder of a drive.
        options: see `TimingOptions`.

    Raises:
        UsageError: a key or value is wrong.
        InputError: the checkpoint or the times cannot be used.
    """
    from rich.console import Console

    from zoo.extras.car.loop_times import read_loop_times

    checkpoint = str(find_checkpoint(ckpt))
    measured = read_loop_times(times, options.rate, options.part)
    with loading():
        from zoo.extras.car.highest_speed import find_highest_speeds
    return find_highest_speeds(checkpoint, measured, options, Console(emoji=False))


if __name__ == "__main__":
    timing.run()
