"""`drivezoo evaluate`: score a checkpoint by driving."""

from typing import TYPE_CHECKING

from rich.console import Console

from zoo.base.command import command, is_help
from zoo.base.errors import UsageError
from zoo.base.run_command import exit_after
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.cli.console_progress import loading
from zoo.evaluate.evaluate_options import EvaluateOptions, ReplayOptions

if TYPE_CHECKING:
    from zoo.evaluate.evaluation import Evaluation
    from zoo.evaluate.replay_score import Replay

REPLAY = ("replay=", "evaluate.replay=", "--replay=")


@command
def evaluate(ckpt: str, *, options: EvaluateOptions) -> "Evaluation":
    """Score a checkpoint by driving.

    Drives it in the embedded world, with several drives in parallel and without a display, and
    writes figures, drives and plots.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet; in Python also a policy.
        options: see `EvaluateOptions`.

    Raises:
        UsageError: a key or value is wrong.
        InputError: the checkpoint cannot be used; or the network steered NaN, after all files are
            written.
    """
    if options.replay is not None:
        raise UsageError("replay: call drivezoo.replay(driver, recording)")
    driver = find_driver(ckpt)  # reports a wrong path before torch is imported
    with loading():
        from zoo.evaluate.evaluation import score_driver
    return score_driver(driver, options, Console(emoji=False))


@command
def replay(ckpt: str, recording: str, *, options: ReplayOptions) -> "Replay":
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
        from zoo.evaluate.replay_score import replay_recording
    return replay_recording(driver, recording, options, Console(emoji=False))


def evaluate_or_replay(arguments: list[str]) -> None:
    """Evaluate in the embedded world, or on the recording of `replay=`."""
    given = [argument for argument in arguments if argument.startswith(REPLAY)]
    if not given or is_help(arguments):
        evaluate.main(arguments)
        return
    if len(given) > 1:
        raise UsageError("replay: given twice; give it once")
    first, *others = [
        argument.removeprefix("evaluate.") for argument in arguments if argument not in given
    ]
    replay.main([first, given[0].partition("=")[2], *others])


if __name__ == "__main__":
    exit_after("drivezoo evaluate", evaluate_or_replay)
