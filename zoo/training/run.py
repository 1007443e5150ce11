"""Run one experiment, from its config to its figures."""

import json
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import lightning
import torch
from lightning.fabric.utilities.exceptions import MisconfigurationException
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.recorded_car import other_car
from datamodules.run_data import RunData
from datamodules.split import write_split
from zoo.base.compose import plain_dict
from zoo.base.errors import InputError, hint
from zoo.base.process_ranks import is_first_process, needs_processes
from zoo.base.terminal import print_line
from zoo.base.whole_file import refuse_links_out, write_whole
from zoo.checkpoints.checkpoint import make_card, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import STARTED_IN
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.status import run_status
from zoo.scoring.replay_score import held_out_replay
from zoo.scoring.track_scores import run_options, score_run
from zoo.training import build, candidates, conclusion, interruptions
from zoo.training.closed_loop import best_drive
from zoo.training.data_facts import print_start, recorded_facts, rows_apart
from zoo.training.distributed import ending_together
from zoo.training.host_settings import set_up_process
from zoo.training.plan import make_plan
from zoo.training.precision import choose_precision
from zoo.training.run_config import settle_config, with_file_settings
from zoo.training.run_loggers import log_config, log_results
from zoo.training.run_module import RunModule, callbacks_of, profiler_of


def run_experiment(
    config: DictConfig,
    folder: Path,
    resume: bool = False,
    typed: Sequence[str] = (),
    verdict: bool = True,
    bf16: bool | None = None,
) -> None:
    """Run an experiment in `folder`; with `resume`, from its last checkpoint.

    With `typed`, the overrides of the whole run, these and `config` replace the folder's own once
    they are known to fit the checkpoint: a run that is stopped again resumes with them. Without
    `verdict`, no verdict and no next command is printed: a command that drives the network itself
    prints its own. `bf16` is that of `choose_precision`.

    Raises:
        InputError: the config, the recording or a file is wrong, or another process trains in the
            folder.
        StoppedError: on Ctrl-C.
    """
    if resume:
        refuse_links_out(folder)
    first = is_first_process(needs_processes(config))
    is_fixed = torch.are_deterministic_algorithms_enabled()
    warns = torch.is_deterministic_algorithms_warn_only_enabled()
    with interruptions.naming_lost_files(folder), ExitStack() as after:
        # A notebook, or a sweep's next job, computes in this process, too.
        after.callback(torch.set_num_threads, torch.get_num_threads())
        after.callback(torch.use_deterministic_algorithms, is_fixed, warn_only=warns)
        folder.mkdir(parents=True, exist_ok=True)
        with (
            run_status(folder, first),
            interruptions.naming_lost_files(folder),
            interruptions.naming_resume(folder),
        ):
            _run(config, folder, first, resume, typed, verdict, bf16)


def _run(
    config: DictConfig,
    folder: Path,
    first: bool,
    resume: bool,
    typed: Sequence[str],
    verdict: bool,
    bf16: bool | None,
) -> None:
    started = time.perf_counter()
    code_fingerprint()  # before training: later edits of the files do not count
    console = Console(soft_wrap=True, quiet=not first)
    score = run_options(config.get("score"))
    asked = with_file_settings(config)
    keep_config = bool(typed) or asked is not config  # resuming needs no file of weights
    config = settle_config(asked, console)

    data = build.load_data(config, console)
    apart = rows_apart(data)
    replayed, not_replayed = None, None
    source = other_car(data.recording)
    if source and score is not None:  # the embedded tracks show another camera and another car
        try:
            replayed = held_out_replay(data.recording, data.split, score.replay_speed)
            print_line(console, f"scored by {replayed.words}")
        except InputError as error:
            score, not_replayed = None, str(error)
            print_line(console, f"no score by driving: {error}")
    card = make_card(plain_dict(config), data.view, recorded_facts(data))
    card[STARTED_IN] = str(Path.cwd())
    resumed = interruptions.find_resume_point(folder, card, console) if resume else None

    # Lightning's trainer knows the devices and the processes, which the plan depends on.
    network = build.build_network(config, data.view, console, resumed.path if resumed else None)
    kept = resumed.contents["drivezoo"].get("precision") if resumed else None
    before_s = resumed.contents.get("trained", [0, 0, 0.0])[2] if resumed else 0.0
    precision = choose_precision(config, network, data.view, console, kept, bf16)
    if precision != config.trainer.get("precision"):
        keep_config, asked = True, asked.copy()  # the folder's config repeats the run anywhere
        for settled in (config, asked):
            OmegaConf.update(settled, "trainer.precision", precision, force_add=True)
    card["config"]["trainer"]["precision"] = card["precision"] = precision
    trainer = build.build_trainer(config, folder, has_validation=len(data.split.val) > 0)
    print_start(card, network, data, apart, trainer.strategy.root_device, console)
    if resumed is not None and resumed.is_inside_epoch:
        OmegaConf.update(config, "trainer.group_batches", False, force_add=True)
    plan = make_plan(config, data, network, trainer, console)
    print_line(console, plan.line())
    module = build.build_module(config, network, plan, card, console)
    if resumed is not None:
        resumed.end_early(trainer)
        resumed.check_optimizer(module)
        conclusion.read_curves(folder)  # a damaged file must not fail the training at its end
    if first:
        if resumed is not None:
            candidates.restore_monitored(folder)
        if keep_config:
            (folder / ".hydra").mkdir(exist_ok=True)
            OmegaConf.save(asked, folder / ".hydra" / "config.yaml")
        if typed:
            words = json.dumps([*typed], ensure_ascii=False)  # is YAML; OmegaConf reads ${ in paths
            write_whole(folder / ".hydra" / "overrides.yaml", words)
        write_split(folder / "split.csv", data.recording, data.split, resumed is not None)
        if resumed is not None:
            build.keep_earlier_log(trainer, folder, resumed.contents["global_step"])

    log_config(trainer, card["config"])

    set_up_process(plan.threads)
    data = build.build_feed(data, plan, console)
    with ending_together(trainer, folder, interruptions.resume_command(folder)):
        _fit(trainer, module, data, resumed.path if resumed else None, folder)
        candidates.complete_checkpoints(trainer, folder)
    if not trainer.is_global_zero:
        return

    if summary := profiler_of(trainer).summary():  # as a log message, it would not be shown
        print_line(console, summary)
    monitor = candidates.monitored_figure(trainer)
    choice = candidates.choose_best(score, monitor, folder, console, source)
    module.float()  # as in a loaded checkpoint, whatever trainer.precision left
    if (best := folder / "checkpoints" / "best.ckpt").is_file():
        module.load_state_dict(read_checkpoint_file(best)["state_dict"])
    open_loop = conclusion.evaluate_rows(module, data, console)
    conclusion.save_plots(open_loop, folder, console)
    conclusion.print_open_loop(open_loop, card["config"]["model"]["name"], console)
    fields = {
        "closed_loop": best_drive(trainer, module, data.view),
        "drive": score_run(score, folder, console, replayed),
        "not_replayed": not_replayed,
        "leak": {part: {"seconds": seconds} for part, seconds in apart.items()},
        "choice": choice,
        "device": str(plan.device),
        "threads": plan.threads,
        "precision": plan.precision,
        "wall_s": time.perf_counter() - started + before_s,
    }
    metrics, judged = conclusion.write_metrics(folder, card, data, module, open_loop, fields)
    conclusion.print_conclusion(folder, metrics, judged if verdict else None, console)
    log_results(trainer, card["config"], metrics, folder, console)


def _fit(
    trainer: lightning.Trainer, module: RunModule, data: RunData, path: Path | None, folder: Path
) -> None:
    try:
        trainer.precision_plugin.convert_module(module)  # before its weights are restored
        trainer.fit(module, datamodule=data, ckpt_path=path, weights_only=True)
    except (SystemExit, KeyboardInterrupt):
        if not trainer.interrupted:
            raise
    except Exception as error:
        figures = sorted(trainer.callback_metrics)  # known after the first epoch
        for name in {getattr(callback, "monitor", None) for callback in callbacks_of(trainer)}:
            if name and figures and name not in figures and name in str(error):
                raise InputError(f"monitor={name}: no such figure; {hint(name, figures)}") from None
        ours = ("`val_check_interval`", "returned nan values")
        if isinstance(error, MisconfigurationException) or any(word in str(error) for word in ours):
            raise InputError(f"trainer: {' '.join(str(error).split())}") from error
        raise
    if trainer.interrupted:
        epoch = None if trainer.fit_loop.done else trainer.current_epoch + 1
        raise interruptions.stopped_error(folder, epoch)
