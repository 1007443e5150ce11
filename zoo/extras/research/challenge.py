"""`drivezoo evaluate challenge=ch2`: score a checkpoint on an official test."""

from typing import TYPE_CHECKING, Any

from rich.console import Console

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.extras.research.challenge_options import ChallengeOptions

if TYPE_CHECKING:
    from zoo.extras.research.challenge_score import Challenge


@command(outputs=True)
def challenge(ckpt: Any, data: str, *, options: ChallengeOptions) -> "Challenge":
    """Score a checkpoint on the official test of Udacity's Challenge 2.

    Writes the error of the steering wheel's angle on both halves of the test, beside baselines and
    the teams' published predictions, and a submission in the challenge's layout.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet; in Python also a policy.
        data: folder of the test: CH2_final_evaluation.csv, its frames in center, and submissions of
            teams as further CSV files.
        options: see `ChallengeOptions`.

    Raises:
        UsageError: the network was trained on frames of the test, and no split is named.
        InputError: the checkpoint, a frame or a table cannot be used; or the network steered NaN,
            after all files are written.
    """
    driver = find_driver(ckpt)
    with loading():
        from zoo.extras.research.challenge_score import score_challenge
    return score_challenge(driver, data, options, Console(emoji=False))
