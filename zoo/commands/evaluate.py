"""`drivezoo evaluate`: score a checkpoint by driving."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from zoo.base.command import command, is_help
from zoo.base.console_progress import loading
from zoo.base.console_script import challenge_command, load
from zoo.base.errors import UsageError
from zoo.base.run_command import exit_after
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.scoring.evaluate_options import EvaluateOptions, check_world

if TYPE_CHECKING:
    from zoo.scoring.evaluation import Evaluation


@command(outputs=True)
def evaluate(ckpt: Any, *, options: EvaluateOptions) -> "Evaluation":
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
    if options.replay is not None or (options.world != "embedded" and Path(options.world).is_dir()):
        raise UsageError("replay: call drivezoo.replay(driver, recording)")
    if options.challenge is not None or options.data is not None:
        raise UsageError("challenge: call drivezoo.challenge(driver, folder)")
    if options.film_speed != EvaluateOptions.film_speed and not options.film:
        raise UsageError(f"film_speed={options.film_speed:g}: is that of film=true; add it, too")
    # Report a wrong path or track before torch is imported.
    driver = find_driver(ckpt)
    if options.track and options.world == "embedded":
        check_world(options)
    with loading():
        from zoo.scoring.evaluation import score_driver
    return score_driver(driver, options, Console(emoji=False))


# Commands that score elsewhere, by the key that asks for them; the key of their second argument.
ELSEWHERE = {"replay": "replay", "challenge": "data"}


def evaluate_or_replay(arguments: list[str]) -> None:
    """Evaluate in the embedded world, or where `replay=`, `challenge=` or a folder's `world=` says.

    Raises:
        UsageError: a key of these is given twice, or lacks the other one.
    """
    typed: dict[str, str] = {}
    others = []
    for argument in arguments:
        name, _, value = argument.removeprefix("--").removeprefix("evaluate.").partition("=")
        if name == "world" and Path(value).expanduser().is_dir():
            name = "replay"
        if name not in ("replay", "challenge", "data") or "=" not in argument:
            others.append(argument.removeprefix("evaluate."))
        elif name in typed:
            raise UsageError(f"{name}: given twice; give it once")
        else:
            typed[name] = value
    asked = next((name for name in ELSEWHERE if name in typed), None)
    if asked is None:
        if "data" in typed and not is_help(arguments):
            raise UsageError("data=: is the folder of a test; name the test, challenge=ch2")
        evaluate.main(arguments)
        return
    is_test, key = asked == "challenge", ELSEWHERE[asked]
    function = challenge_command(typed[asked]) if is_test else load("zoo.commands.replay:replay")
    if is_help(arguments):
        function.main(["--help"])
        return
    if key not in typed:
        raise UsageError(f"{asked}=: needs the folder of the test, {key}=FOLDER")
    function.main([*others[:1], typed[key], *others[1:]])


if __name__ == "__main__":
    exit_after("drivezoo evaluate", evaluate_or_replay)
