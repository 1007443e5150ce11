"""`drivezoo replay`: score a checkpoint on any recording."""

from typing import TYPE_CHECKING, Any

from rich.console import Console

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.scoring.evaluate_options import ReplayOptions

if TYPE_CHECKING:
    from zoo.scoring.replay_score import Replay


@command(outputs=True)
def replay(ckpt: Any, recording: str, *, options: ReplayOptions) -> "Replay":
    """Score a checkpoint on any recording.

    Needs no simulator: warps the recorded frames to the position that the network steers to.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet; in Python also a policy.
        recording: recording's folder.
        options: see `ReplayOptions`.

    Raises:
        InputError: the checkpoint or the recording cannot be used; or the network steered NaN,
            after all files are written.
    """
    driver = find_driver(ckpt)
    with loading():
        from zoo.scoring.replay_score import replay_recording
    return replay_recording(driver, recording, options, Console(emoji=False))


if __name__ == "__main__":
    replay.run()
