"""The checkpoint that a stopped run resumes from, checked against the new training."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.checkpoints.checkpoint_card import check_part
from zoo.training.interruptions import kept_without_last
from zoo.training.steering_module import SteeringModule


@dataclass(frozen=True)
class ResumePoint:
    """A run's `last.ckpt`.

    Attributes:
        path: checkpoint file.
        group_sizes: number of parameters in each group of its optimizer.
    """

    path: Path
    group_sizes: list[int]

    def check_optimizer(self, module: SteeringModule) -> None:
        """Raise InputError if the new optimizer has other groups than the saved one."""
        groups = module.make_optimizer(module.parameter_groups()).param_groups
        now = [len(group["params"]) for group in groups]
        if self.group_sizes != now:
            raise InputError(
                f"{self.path}: its optimizer has groups of {self.group_sizes} parameters, but "
                f"these settings (optim, model) and this version of drivezoo give {now}; set the "
                "values that the run was started with, or start a new run with "
                f"model.weights={self.path}"
            )


def find_resume_point(folder: Path, card: dict, console: Console) -> ResumePoint | None:
    """Return where a run resumes; where no epoch was complete, print that and return None.

    Args:
        folder: run's folder.
        card: card of the new training, see `zoo.checkpoints.checkpoint.make_card`.
        console: console for that line.

    Raises:
        InputError: the checkpoint cannot be read, or was trained on another recording.
    """
    last = folder / "checkpoints" / "last.ckpt"
    if not last.is_file():
        if (last.parent / "best.ckpt").is_file():
            line = f"training starts again at the first epoch: {kept_without_last(folder)}"
            console.print(line, highlight=False, markup=False)
        return None
    checkpoint = read_checkpoint_file(last)  # executes no code from the file
    check_part(checkpoint["drivezoo"], last)
    before = checkpoint["drivezoo"]["data"]
    if any(before.get(key) != card["data"][key] for key in ("fingerprint", "rows")):
        raise InputError(
            f"{last}: was trained on {before['rows']} rows ({before['fingerprint']}), "
            f"data.root now holds {card['data']['rows']} ({card['data']['fingerprint']}); restore "
            f"the recording, or start a new run with model.weights={last}"
        )
    saved = checkpoint["optimizer_states"][0]["param_groups"]
    return ResumePoint(last, [len(group["params"]) for group in saved])
