"""`drivezoo correct`: train a checkpoint on its own driving errors."""

from dataclasses import replace
from pathlib import Path

from zoo.base.command import command
from zoo.base.command_keys import changed
from zoo.base.console_progress import loading
from zoo.base.errors import StoppedError
from zoo.base.new_folder import command_folder, dated_folder
from zoo.base.terminal import command_line, print_written, shown_path
from zoo.base.whole_file import refuse_links_out
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.extras.corrections.correct_options import CorrectOptions, check_correct_options

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


@command(config=True)
def correct(ckpt: str, *overrides: str, options: CorrectOptions) -> None:
    """Train a checkpoint on its own driving errors.

    Each round drives the checkpoint, asks the expert for the right steering in the frames it saw,
    and continues the training with these corrections (DAgger: Ross, Gordon and Bagnell 2011,
    arXiv:1011.0686). The same command with the same out= resumes a stopped correction. Keys with a
    dot, such as data.root=FOLDER or optim.lr=0.0003, change the checkpoint's config.

    Args:
        ckpt: checkpoint: a .ckpt file, a run's folder, latest, or a network that comes with
            drivezoo, such as lenet.
        *overrides: keys of the checkpoint's config.
        options: see `CorrectOptions`.

    Raises:
        StoppedError: on Ctrl-C; names the command that resumes.
    """
    check_correct_options(options)
    path = str(find_checkpoint(ckpt))
    from rich.console import Console

    with loading():
        from zoo.extras.corrections.correction import NAME, Correction, best_round, rounds_table
        from zoo.scoring.evidence import next_drive

    console = Console(soft_wrap=True)
    folder = Path(options.out or dated_folder("corrections")).expanduser().absolute()
    refuse_links_out(folder)
    try:
        with command_folder(folder, "corrections", resumed_by=NAME):
            correction = Correction(path, options, list(overrides), folder, console)
            rounds = correction.run()
    except (KeyboardInterrupt, StoppedError):
        words = [path, *changed(replace(options, out=shown_path(folder))), *overrides]
        again = command_line(["drivezoo", "correct", *words])
        raise StoppedError(f"stopped; finished rounds are kept; resume with: {again}") from None
    console.print(rounds_table(rounds))
    best, data = best_round(rounds), correction.checkpoint.data
    if best["number"]:
        console.print(f"best checkpoint: round {best['number']}", highlight=False)
    elif rounds[1:]:
        console.print("no round drives better than the original checkpoint", highlight=False)
    made = best["checkpoint"]
    following = next_drive(made, data, ["benchmark", made, "suite=quick"])
    print_written([made if best["number"] else folder], following, console)


if __name__ == "__main__":
    correct.run()
