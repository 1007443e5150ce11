"""The checkpoint that a stopped run resumes from, checked against what is to be trained."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from datamodules.errors import InputError
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.training.interruptions import kept_without_last
from zoo.training.steering_module import SteeringModule


@dataclass(frozen=True)
class ResumePoint:
    """A run's `last.ckpt`.

    Attributes:
        path: the file.
        group_sizes: how many parameters are in each group of its optimizer.
    """

    path: Path
    group_sizes: list[int]

    def check_optimizer(self, module: SteeringModule) -> None:
        """Raise InputError where the optimizer to be has other groups than the saved one."""
        made = module.configure_optimizers()["optimizer"].param_groups
        now = [len(group["params"]) for group in made]
        if self.group_sizes != now:
            raise InputError(
                f"{self.path}: its optimizer held groups of {self.group_sizes} parameters, with "
                f"these settings (optim, model) and this version of drivezoo they are {now}: it "
                "cannot go on; set what it was begun with, or start a new run with "
                f"model.weights={self.path}"
            )


def find_resume_point(folder: Path, card: dict, console: Console) -> ResumePoint | None:
    """Return where a run resumes; None where no epoch was complete, which is printed.

    Args:
        card: of the training to be, see `zoo.checkpoints.checkpoint.make_card`.

    Raises:
        InputError: the checkpoint cannot be read, or was trained on another recording.
    """
    last = folder / "checkpoints" / "last.ckpt"
    if not last.is_file():
        if (last.parent / "best.ckpt").is_file():
            line = f"begins again: {kept_without_last(folder)}"
            console.print(line, highlight=False, markup=False)
        return None
    checkpoint = read_checkpoint_file(last)  # runs nothing that is in it
    before = checkpoint["drivezoo"]["data"]
    if before != card["data"]:
        raise InputError(
            f"{last}: was trained on {before['rows']} rows ({before['fingerprint']}), "
            f"data.root now holds {card['data']['rows']} ({card['data']['fingerprint']}); bring "
            f"the recording back, or start a new run with model.weights={last}"
        )
    saved = checkpoint["optimizer_states"][0]["param_groups"]
    return ResumePoint(last, [len(group["params"]) for group in saved])
