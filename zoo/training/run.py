"""One experiment: load, train, test, report. The main job."""

import time
from pathlib import Path

import lightning
import torch
from lightning.pytorch.callbacks import ModelCheckpoint
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from datamodules.leak import Leak
from datamodules.split import PARTS, write_split
from zoo.checkpoints.checkpoint import make_card, read_checkpoint_file
from zoo.checkpoints.initial_weights import load_weights
from zoo.cli.console_progress import working
from zoo.cli.process_ranks import is_first_process, needs_processes
from zoo.evaluate.track_scores import run_options
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.status import run_status
from zoo.runs.whole_file import refuse_links_out
from zoo.training.build import build_data, build_module, build_trainer, settle_config
from zoo.training.candidates import choose_best, restore_monitored
from zoo.training.conclusion import (
    TrainedRun,
    drive_best,
    evaluate_rows,
    print_conclusion,
    print_open_loop,
    save_plots,
    write_metrics,
)
from zoo.training.distributed import ending_together
from zoo.training.frozen_layers import feed_cached_features, random_front_lines
from zoo.training.interruptions import naming_lost_files, resume_command, stopped_error
from zoo.training.openmp_threads import spinning_while_quiet
from zoo.training.plan import set_pace
from zoo.training.resume_point import ResumePoint, find_resume_point
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
    with naming_lost_files(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with naming_lost_files(folder), run_status(folder, first), naming_lost_files(folder):
        started = time.perf_counter()
        code_fingerprint()  # of what is imported now; who edits it while it trains changes nothing
        console = Console(soft_wrap=True, quiet=not first)
        score = run_options(config.get("score"))
        asked, config = config, settle_config(config, console)
        data = build_data(config)
        data.load(console)
        card = make_card(
            OmegaConf.to_container(config, resolve=True),
            data.view,
            {"fingerprint": data.recording.fingerprint(), "rows": len(data.recording)},
        )
        module = build_module(config, data, card)
        start = find_resume_point(folder, card, console) if resume else None
        if start is not None:
            start.check_optimizer(module)
        if start is not None and first:
            restore_monitored(folder)
        if start is not None:  # what is computed before training begins wants its weights, too
            load_weights(module.network, str(start.path))
        elif config.model.weights is not None:
            said = load_weights(module.network, str(config.model.weights))
            console.print(f"weights: {said}", highlight=False, markup=False)
        if first and keep_config:
            OmegaConf.save(asked, folder / ".hydra" / "config.yaml")
        if first:
            write_split(folder / "split.csv", data.recording, data.split)
        trainer = build_trainer(config, folder, has_validation=len(data.split.val) > 0)
        with working("measuring train/validation similarity", console):
            leaks = data.leaks()
        _say_what_runs(console, config, module, data, leaks, trainer)
        set_pace(config, module, data, trainer, console)
        with spinning_while_quiet(torch.get_num_threads()):
            feed_cached_features(config, module, data, trainer, console)
            with ending_together(trainer, folder, resume_command(folder)):
                _fit(trainer, module, data, start, folder)
            if not trainer.is_global_zero:
                return float("nan")
            choice = choose_best(score, _monitor(trainer), folder, console)
            _take_best(module, folder)
            trained = TrainedRun(folder, card, data, leaks, module, trainer)
            open_loop = evaluate_rows(module, data, console)
            save_plots(open_loop, folder, console)
            print_open_loop(open_loop, config.model.name, console)
            drives = drive_best(trained, score, console)
            metrics, verdict = write_metrics(trained, choice, open_loop, drives, started)
            print_conclusion(folder, metrics, verdict, console)
            return open_loop.figures.get("val", {}).get("mse", float("nan"))


def _say_what_runs(
    console: Console,
    config: DictConfig,
    module: SteeringModule,
    data: DrivingData,
    leaks: dict[str, Leak],
    trainer: lightning.Trainer,
) -> None:
    height, width, _ = data.view.shape
    parameters = sum(p.numel() for p in module.network.parameters())
    split = ", ".join(f"{len(getattr(data.split, part)):,} {part}" for part in PARTS)
    for line in (
        f"{config.model.name}: {parameters:,} parameters, sees {width} x {height} "
        f"{data.view.colour}, on {trainer.strategy.root_device}",
        f"split by {config.data.split}: {split} rows; {len(data.samples):,} training samples",
        *_leak_lines(leaks),
        *random_front_lines(config, module.network),
    ):
        console.print(line, highlight=False, markup=False)


def _leak_lines(leaks: dict[str, Leak]) -> list[str]:
    return [
        f"leak: a {part} frame is {leak.seconds:.2f} s from the nearest training frame, and differs"
        f" {leak.likeness:.0%} as much from the most alike as from any (medians)"
        for part, leak in leaks.items()
    ]


def _fit(
    trainer: lightning.Trainer,
    module: SteeringModule,
    data: DrivingData,
    start: ResumePoint | None,
    folder: Path,
) -> None:
    try:
        path = start.path if start else None
        trainer.fit(module, datamodule=data, ckpt_path=path, weights_only=True)
    except SystemExit:
        if not trainer.interrupted:
            raise
    except KeyboardInterrupt:
        pass
    if trainer.interrupted:
        raise stopped_error(folder, trainer.current_epoch + 1)
    if trainer.max_epochs == 0:  # nothing to learn: only carry the weights over to a checkpoint
        for name in ("best", "last"):
            trainer.save_checkpoint(folder / "checkpoints" / f"{name}.ckpt")


def _monitor(trainer: lightning.Trainer) -> str | None:
    """Return the figure by which `best.ckpt` was kept; None where the last epoch's was."""
    names = {
        Path(one.filename or "").stem: one.monitor
        for one in trainer.callbacks
        if isinstance(one, ModelCheckpoint)
    }
    return names.get("best")


def _take_best(module: SteeringModule, folder: Path) -> None:
    best = folder / "checkpoints" / "best.ckpt"
    if best.is_file():
        module.load_state_dict(read_checkpoint_file(best)["state_dict"])
