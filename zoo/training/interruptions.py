"""A stopped run or a lost disk: what is kept, how to resume, and from which checkpoint."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import lightning
from lightning.pytorch.callbacks import EarlyStopping
from rich.console import Console

from zoo.base.command_keys import typed_keys
from zoo.base.errors import InputError, StoppedError, UsageError
from zoo.base.process_pool import KilledProcessError
from zoo.base.run_command import was_stopped
from zoo.base.terminal import command_line, counted, print_line
from zoo.checkpoints.checkpoint import check_part, read_checkpoint_file, trained_epochs
from zoo.runs.status import read_status
from zoo.training.host_settings import AUTO
from zoo.training.obeyed_keys import unobeyed
from zoo.training.run_module import RunModule, callbacks_of
from zoo.training.steering_module import SteeringModule

# Keys that a user may edit in a stopped run: callbacks, and files that are read or compared.
UNTRAINED = ("callbacks.", "data.record.", "data.rig", "data.split", "model.weights")


@contextmanager
def naming_lost_files(folder: Path) -> Iterator[None]:
    """Raise InputError for a full disk or a removed folder; name the file and what is kept."""
    before = threading.excepthook
    # TensorBoard writes in a thread; the main thread raises its errors, too.
    threading.excepthook = lambda failed: isinstance(failed.exc_value, OSError) or before(failed)
    try:
        yield
    except OSError as error:
        fix = f"{folder} was removed, with all that the run had saved; start the run again"
        if folder.is_dir():
            fix = f"{kept(folder)}; once it can be written, resume with: {resume_command(folder)}"
        raise InputError(f"{error.filename or folder}: {error.strerror or error}; {fix}") from error
    finally:
        threading.excepthook = before


@contextmanager
def naming_resume(folder: Path) -> Iterator[None]:
    """Name the command that resumes, for a Ctrl-C within the block or a process that drove."""
    try:
        yield
    except KilledProcessError as error:
        words = str(error).replace("try ", "try ++score.")  # score=lake does not name the key
        raise InputError(f"score.{words}, and resume with: {resume_command(folder)}") from error
    except BaseException as error:
        if was_stopped(error) and not isinstance(error, StoppedError):
            raise stopped_error(folder) from error
        raise


def resume_command(folder: Path) -> str:
    """Return the command that resumes a run."""
    return command_line(["drivezoo", "train", f"resume={folder}"])


def kept(folder: Path) -> str:
    """Return which checkpoint of a stopped run is kept."""
    last, best = (folder / "checkpoints" / f"{name}.ckpt" for name in ("last", "best"))
    if last.is_file():
        return f"{last} is kept"
    if best.is_file():
        return f"{best} is kept, but there is no last.ckpt to resume from"
    return "no epoch was complete yet"


def stopped_error(folder: Path, epoch: int | None = None) -> StoppedError:
    """Return the error of a run that was stopped in an epoch, from 1; None for none of them."""
    done = f"stopped{f' in epoch {epoch}' if epoch else ''}; {kept(folder)}"
    if (finished := read_status(folder).get("finished_epochs")) is not None:
        done += f"; metrics.json holds the figures of {finished} finished epochs"
    return StoppedError(f"{done}; resume with: {resume_command(folder)}")


@dataclass(frozen=True)
class ResumePoint:
    """A run's `last.ckpt`.

    Attributes:
        path: checkpoint file.
        contents: checkpoint's contents.
    """

    path: Path
    contents: dict

    @property
    def is_inside_epoch(self) -> bool:
        """Return whether batches of the epoch are left; what is done is counted in single ones."""
        return not self.contents["loops"]["fit_loop"]["epoch_loop.batch_progress"]["is_last_batch"]

    def end_early(self, trainer: lightning.Trainer) -> None:
        """Let a trainer train no further epoch if early stopping had ended the training."""
        patience = [c.patience for c in callbacks_of(trainer) if isinstance(c, EarlyStopping)]
        if has_stopped_early(self.contents, max(patience, default=None)):
            # Not one more: `SteeringModule` would resume inside an epoch that was ended early.
            trainer.fit_loop.max_epochs = self.contents["epoch"]

    def check_optimizer(self, module: RunModule) -> None:
        """Raise InputError if the new optimizer has other groups than the saved one."""
        if not isinstance(module, SteeringModule):
            return
        saved = self.contents["optimizer_states"][0]["param_groups"]
        groups = module.make_optimizer(module.parameter_groups()).param_groups
        then, now = ([len(group["params"]) for group in part] for part in (saved, groups))
        if then != now:
            raise InputError(
                f"{self.path}: its optimizer has groups of {then} parameters, but "
                f"these settings (optim, model) and this version of drivezoo give {now}; set the "
                "values that the run was started with, or start a new run with "
                f"model.weights={self.path}"
            )


def has_stopped_early(contents: dict, patience: int | None) -> bool:
    """Return whether early stopping ended a training at its checkpoint, and again would.

    Args:
        contents: checkpoint's contents.
        patience: epochs for which it now waits; None without early stopping.
    """
    states = contents.get("callbacks") or {}
    state = next((states[key] for key in states if key.startswith("EarlyStopping")), None)
    if state is None or patience is None:
        return False
    reason = state.get("stopping_reason", state["stopped_epoch"])  # 0 for no stop, as the epoch is
    has_stopped = bool(reason) and state["stopped_epoch"] == contents["epoch"]
    return has_stopped and not state["patience"] <= state["wait_count"] < patience


def find_resume_point(folder: Path, card: dict, console: Console) -> ResumePoint | None:
    """Return where a run resumes; where no epoch was complete, print that and return None.

    Args:
        folder: run's folder.
        card: card of the new training, see `zoo.checkpoints.checkpoint.make_card`.
        console: console for that line.

    Raises:
        InputError: the checkpoint cannot be read, or was trained on another recording or with
            other values.
        UsageError: it was trained for more epochs than it should be.
    """
    last = folder / "checkpoints" / "last.ckpt"
    if not last.is_file():
        if last.parent.is_dir():
            print_line(console, f"training starts at the first epoch: {kept(folder)}")
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
    then, now = (dict(typed_keys(facts["config"])) for facts in (checkpoint["drivezoo"], card))
    for key, (was, value) in unobeyed(then, now).items():
        # A later drivezoo has further keys.
        if key in then and AUTO not in (was, value) and not key.startswith(UNTRAINED):
            raise InputError(
                f"{folder / '.hydra' / 'config.yaml'}: {key} is {value}, and was {was} in the "
                f"finished epochs; set it to that, or start a new run with model.weights={last}"
            )
    epochs, most = trained_epochs(checkpoint), card["config"]["trainer"]["max_epochs"]
    if most < epochs:
        raise UsageError(
            f"trainer.max_epochs={most}: {counted(epochs, 'epoch')} of {folder} are finished; "
            f"set it to {epochs} or more"
        )
    return ResumePoint(last, checkpoint)
