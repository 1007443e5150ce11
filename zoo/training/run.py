"""One experiment: load, train, test, report. The main job."""

import io
import shlex
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import lightning
import torch
from lightning.pytorch.callbacks import ModelCheckpoint
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from datamodules.errors import InputError
from datamodules.split import PARTS, write_split
from zoo.checkpoints.checkpoint import make_card, read_checkpoint_file
from zoo.checkpoints.initial_weights import load_weights
from zoo.cli.console_progress import working
from zoo.cli.process_ranks import is_first_process, needs_processes
from zoo.cli.stop_errors import StoppedError
from zoo.evaluate.track_scores import run_options
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.status import read_status, run_status
from zoo.runs.whole_file import refuse_links_out
from zoo.training.build import apply_quick, build_data, build_module, build_trainer
from zoo.training.candidates import choose_best, restore_monitored
from zoo.training.conclusion import report_outcome
from zoo.training.distributed import ending_together
from zoo.training.embedded_recording import apply_recording
from zoo.training.frozen_layers import feed_cached_features, random_front_lines
from zoo.training.openmp_threads import spinning_while_quiet
from zoo.training.plan import set_pace
from zoo.training.steering_module import SteeringModule


def run_experiment(
    config: DictConfig, folder: Path, resume: bool = False, keep_config: bool = False
) -> float:
    """Run what `config` says in `folder`; with `resume`, from its last checkpoint.

    With `keep_config` it replaces the folder's config once it is known to fit the checkpoint, so
    that a run that is stopped again is resumed with it.

    Returns the validation MSE of the best checkpoint (NaN without validation rows), which a
    sweeper can minimise.

    Raises:
        InputError: anything wrong with the config, the recording or a file; another process is
            training in the folder.
        StoppedError: on Ctrl-C.
    """
    if resume:
        refuse_links_out(folder)
    first = is_first_process(needs_processes(config))
    with _naming_files(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with _naming_files(folder), run_status(folder, first), _naming_files(folder):
        started = time.perf_counter()
        code_fingerprint()  # of what is imported now; who edits it while it trains changes nothing
        console = Console(soft_wrap=True, quiet=not first)
        asked = config.copy()
        apply_quick(config)
        score = run_options(config.get("score"))
        apply_recording(config, console)
        data = build_data(config)
        data.load(console)
        card = make_card(
            OmegaConf.to_container(config, resolve=True),
            data.view,
            {"fingerprint": data.recording.fingerprint(), "rows": len(data.recording)},
        )
        module = build_module(config, data, card)
        last = folder / "checkpoints" / "last.ckpt"
        start = _checked_last(last, card, module) if resume and last.is_file() else None
        if start is not None and first:
            restore_monitored(folder)
        if resume and start is None and (best := _best(folder)).is_file():
            console.print(f"begins again: {_without_last(best)}", highlight=False, markup=False)
        if start is not None:  # what is computed before training begins wants its weights, too
            load_weights(module.network, str(start))
        elif config.model.weights is not None:
            said = load_weights(module.network, str(config.model.weights))
            console.print(f"weights: {said}", highlight=False, markup=False)
        if first and keep_config:
            OmegaConf.save(asked, folder / ".hydra" / "config.yaml")
        if first:
            write_split(folder / "split.csv", data.recording, data.split)
        trainer = build_trainer(config, folder, has_validation=len(data.split.val) > 0)
        _say_what_runs(console, config, module, data, trainer)
        set_pace(config, module, data, trainer, console)
        with spinning_while_quiet(torch.get_num_threads()):
            feed_cached_features(config, module, data, trainer, console)
            with ending_together(trainer, folder, _resume_command(folder)):
                _fit(trainer, module, data, start, folder)
            if not trainer.is_global_zero:
                return float("nan")
            choice = choose_best(score, _monitor(trainer), folder, console)
            _take_best(module, folder)
            return report_outcome(
                config, score, choice, folder, module, data, trainer, console, started
            )


def _checked_last(last: Path, card: dict, module: SteeringModule) -> Path:
    """The checkpoint to resume from, read once without running anything in it."""
    checkpoint = read_checkpoint_file(last)
    before = checkpoint["drivezoo"]
    if before["data"] != card["data"]:
        raise InputError(
            f"{last}: was trained on {before['data']['rows']} rows "
            f"({before['data']['fingerprint']}), data.root now holds {card['data']['rows']} "
            f"({card['data']['fingerprint']}); bring the recording back, or start a new run with "
            f"model.weights={last}"
        )
    saved = checkpoint["optimizer_states"][0]["param_groups"]
    made = module.configure_optimizers()["optimizer"].param_groups
    then, now = ([len(group["params"]) for group in groups] for groups in (saved, made))
    if then != now:
        raise InputError(
            f"{last}: its optimizer held groups of {then} parameters, with these settings (optim, "
            f"model) and this version of drivezoo they are {now}: it cannot go on; set what it was "
            f"begun with, or start a new run with model.weights={last}"
        )
    return last


def _say_what_runs(
    console: Console,
    config: DictConfig,
    module: SteeringModule,
    data: DrivingData,
    trainer: lightning.Trainer,
) -> None:
    height, width, _ = data.view.shape
    parameters = sum(p.numel() for p in module.network.parameters())
    split = ", ".join(f"{len(getattr(data.split, part)):,} {part}" for part in PARTS)
    for line in (
        f"{config.model.name}: {parameters:,} parameters, sees {width} x {height} "
        f"{data.view.colour}, on {trainer.strategy.root_device}",
        f"split by {config.data.split}: {split} rows; {len(data.samples):,} training samples",
        *_leak_lines(data, console),
        *random_front_lines(config, module.network),
    ):
        console.print(line, highlight=False, markup=False)


def _leak_lines(data: DrivingData, console: Console) -> list[str]:
    with working("measuring train/validation similarity", console):
        data.measured_leaks = data.leaks()
    return [
        f"leak: a {part} frame is {leak.seconds:.2f} s from the nearest training frame, and differs"
        f" {leak.likeness:.0%} as much from the most alike as from any (medians)"
        for part, leak in data.measured_leaks.items()
    ]


def _fit(
    trainer: lightning.Trainer,
    module: SteeringModule,
    data: DrivingData,
    start: Path | None,
    folder: Path,
) -> None:
    last = folder / "checkpoints" / "last.ckpt"
    try:
        trainer.fit(module, datamodule=data, ckpt_path=start, weights_only=True)
    except SystemExit:
        if not trainer.interrupted:
            raise
    except KeyboardInterrupt:
        pass
    if trainer.interrupted:
        done = f"the epochs before {trainer.current_epoch + 1} are saved"
        if not last.is_file():
            best = _best(folder)
            done = _without_last(best) if best.is_file() else "no epoch was complete yet"
        if (finished := read_status(folder).get("finished_epochs")) is not None:
            done += f"; metrics.json holds the figures of when it had finished {finished}"
        raise StoppedError(f"stopped; {done}; go on with: {_resume_command(folder)}")
    if trainer.max_epochs == 0:  # nothing to learn: only carry the weights over to a checkpoint
        for name in ("best", "last"):
            trainer.save_checkpoint(folder / "checkpoints" / f"{name}.ckpt")


@contextmanager
def _naming_files(folder: Path) -> Iterator[None]:
    """Raise InputError for a full disk, or a folder that was removed: which file, what is kept."""
    before = threading.excepthook
    # TensorBoard writes in a thread, and raises in ours what has failed there.
    threading.excepthook = lambda failed: isinstance(failed.exc_value, OSError) or before(failed)
    try:
        yield
    except OSError as error:
        place = error.filename or _open_file(error) or folder
        last, best = folder / "checkpoints" / "last.ckpt", _best(folder)
        if not folder.is_dir():
            remedy = f"{folder} was removed, with all that the run had saved; start it again"
        else:
            kept = f"{last} is kept"
            if not last.is_file():
                kept = _without_last(best) if best.is_file() else "no epoch was complete yet"
            again = _resume_command(folder)
            remedy = f"{kept}; free some space, or correct that, and go on with: {again}"
        raise InputError(f"{place}: {error.strerror or error}; {remedy}") from error
    finally:
        threading.excepthook = before


def _open_file(error: OSError) -> str | None:
    """Return the file that the failed code had open: an error of writing names none."""
    for frame, _ in reversed(list(traceback.walk_tb(error.__traceback__))):
        for one in frame.f_locals.values():
            if isinstance(one, io.IOBase) and isinstance(getattr(one, "name", None), str):
                return one.name
    return None


def _best(folder: Path) -> Path:
    return folder / "checkpoints" / "best.ckpt"


def _without_last(best: Path) -> str:
    return f"{best} is kept, but there is no last.ckpt to go on from"


def _resume_command(folder: Path) -> str:
    return shlex.join(["python", "-m", "zoo", f"resume={folder}"])


def _monitor(trainer: lightning.Trainer) -> str | None:
    """Return the figure by which `best.ckpt` was kept; None where the last epoch's was."""
    names = {
        Path(one.filename or "").stem: one.monitor
        for one in trainer.callbacks
        if isinstance(one, ModelCheckpoint)
    }
    return names.get("best")


def _take_best(module: SteeringModule, folder: Path) -> None:
    best = _best(folder)
    if best.is_file():
        module.load_state_dict(read_checkpoint_file(best)["state_dict"])
