"""Forget what networks were trained to see, and find it out as `drivezoo import` does.

python benchmarks/input_search.py RECORDING CKPT...
"""

import sys
from dataclasses import replace

from datamodules.recording import read_recordings
from datamodules.view import View
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.input_search.combinations import SCALES, KnownInput
from zoo.input_search.judgement import judge
from zoo.input_search.trial_frames import TrialFrames, read_trial_frames
from zoo.input_search.trials import Trial, try_inputs

FRAMES = 300
COLUMNS = ("trained with", "found", "agreement", "correlation", "recovery", "next crop",
           "next colour", "convincing")  # fmt: skip


def main(arguments: list[str]) -> None:
    folder, *paths = arguments
    frames = read_trial_frames(read_recordings(folder), FRAMES)
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for path in paths:
        checkpoint = load_checkpoint(path)
        print(row(keys(checkpoint.view), checkpoint, frames), flush=True)
        for module in checkpoint.network.modules():
            if hasattr(module, "reset_parameters"):
                module.reset_parameters()
        print(row("untrained", checkpoint, frames), flush=True)


def row(name: str, checkpoint: Checkpoint, frames: TrialFrames) -> str:
    """Return the line of a network in the table."""
    scale = checkpoint.config["model"].get("scale", SCALES[0])
    known = KnownInput(shape=checkpoint.view.shape, scale=tuple(scale))
    trials = try_inputs(lambda view, scale: checkpoint.network, known, frames)
    judged = judge(trials)
    best = judged.best
    others = [one for one in trials.finalists if one is not best]
    view = best.combination.view
    crop = next((one for one in others if is_other_crop(one, view)), None)
    colour = next((one for one in others if one.combination.view.colour != view.colour), None)
    cells = [
        name,
        keys(view),
        f"{best.score:.3f}",
        f"{best.correlation:.3f}",
        "-" if best.recovery is None else f"{best.recovery:+.3f}",
        *("-" if one is None else f"{keys(one.combination.view)}: {one.score:.3f}"
          for one in (crop, colour)),
        "no" if judged.doubts else "yes",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def is_other_crop(trial: Trial, view: View) -> bool:
    """Return whether a trial differs from a view in the crop alone."""
    own = trial.combination.view
    return own.crop != view.crop and own == replace(view, crop=own.crop, resize=own.resize)


def keys(view: View) -> str:
    """Return colour and crop."""
    return f"`{view.colour}` {view.crop[0]},{view.crop[1]}"


if __name__ == "__main__":
    main(sys.argv[1:])
