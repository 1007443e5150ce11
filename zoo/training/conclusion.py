"""What a training has come to: figures, table and plots of its best checkpoint."""

import platform
import time
from importlib.metadata import version
from pathlib import Path

import lightning
import torch
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from datamodules.driving import DrivingData
from datamodules.findings import find_oddities
from datamodules.split import PARTS
from zoo.callbacks.closed_loop import best_drive
from zoo.checkpoints.checkpoint import read_checkpoint_file
from zoo.checkpoints.checkpoint_path import short_name
from zoo.cli.console_progress import working
from zoo.evaluate.track_scores import RunScore, score_run
from zoo.report.open_loop_table import metrics_table
from zoo.report.write_up import write_report
from zoo.runs import curves_files, plots
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.metrics_file import write_metrics_file
from zoo.training.candidates import Choice
from zoo.training.open_loop import (
    baseline_metrics,
    open_loop_metrics,
    predict_steering,
    side_response,
)
from zoo.training.steering_module import SteeringModule
from zoo.verdict.evidence import evidence_of_run
from zoo.verdict.judgement import judge, print_verdict

PACKAGES = ("drivezoo", "torch", "lightning", "albumentations", "opencv-python-headless", "numpy")


def report_outcome(
    config: DictConfig,
    score: RunScore | None,
    choice: Choice | None,
    folder: Path,
    module: SteeringModule,
    data: DrivingData,
    trainer: lightning.Trainer,
    console: Console,
    started: float,
) -> float:
    """Write `metrics.json` and plots, drive as `score` says, print it all; `module` holds the best
    weights.

    Returns the validation MSE, NaN without validation rows.
    """
    train_mean = float(data.recording.steering[data.split.train].mean())
    figures, baselines, responses = {}, {}, {}
    for part in PARTS:
        rows = getattr(data.split, part)
        if not len(rows):
            continue
        batches = data.evaluation_batches(part)
        with working(f"predicting {part} rows", console):
            predicted = predict_steering(module, batches)
        true = data.recording.steering[rows]
        figures[part] = open_loop_metrics(predicted, true)
        baselines[part] = baseline_metrics(true, train_mean)
        if part != "train":
            with working(f"predicting and plotting {part} rows", console):
                sides = (predict_steering(module, side) for side in batches.sides())
                responses[part] = side_response(*sides)
                figure = plots.predicted_against_true(predicted, true, f"{part}, best checkpoint")
                plots.save_figure(figure, folder / "plots" / f"predicted_against_true_{part}.png")
    zero = baselines.get("val", baselines["train"])["always zero"]["mse"]
    curves = read_curves(folder)
    if curves["train/loss"]:
        figure = plots.training_curves(curves["train/loss"], curves["val/mse"], zero)
        plots.save_figure(figure, folder / "plots" / "training_curves.png")
    samples, seconds = module.train_samples, module.train_seconds
    best = _best_epoch(folder) if curves["val/mse"] else None
    console.print(metrics_table(config.model.name, figures, baselines))
    if (response := responses.get("test")) is not None:
        console.print(
            f"response to the side cameras, test rows: {response:+.3f} (turns back if above 0)",
            highlight=False,
        )
    closed_loop = best_drive(trainer, module, data.view)
    drive = score_run(score, folder, console)
    metrics = {
        "model": config.model.name,
        "parameters": sum(p.numel() for p in module.network.parameters()),
        "open_loop": figures,
        "side_response": responses,
        "baselines": baselines,
        "drive": drive,
        "closed_loop": closed_loop,
        "leak": {part: vars(leak) for part, leak in data.measured_leaks.items()},
        "epochs": trainer.current_epoch,
        "train_samples": samples // max(module.train_epochs, 1) * trainer.current_epoch,
        "best_epoch": best,
        "choice": choice.plain() if choice else None,
        "samples_per_second": samples / seconds if seconds else None,
        "seconds_per_epoch": seconds / module.train_epochs if seconds else None,
        "wall_s": time.perf_counter() - started,
        "seed": config.seed,
        "device": str(trainer.strategy.root_device),
        "threads": torch.get_num_threads(),
        "data": {
            "fingerprint": data.recording.fingerprint(),
            "rows": len(data.recording),
            "split": {part: len(getattr(data.split, part)) for part in PARTS},
        },
        "findings": [vars(one) for one in find_oddities(data.recording)],
        "code": code_fingerprint(),
        "versions": {"python": platform.python_version()}
        | {package: version(package) for package in PACKAGES},
    }
    evidence = evidence_of_run(folder, OmegaConf.to_container(config, resolve=True), metrics)
    verdict = judge(drive["drives"] if drive else [], evidence)
    metrics["verdict"] = verdict.plain()
    write_metrics_file(folder, metrics)
    if seconds:
        console.print(
            f"{trainer.current_epoch} epochs, {samples / seconds:,.0f} samples/s, "
            f"{metrics['wall_s']:.0f} s in all" + (f"; best after epoch {best}" if best else ""),
            highlight=False,
        )
    try:
        with working("writing the report", console):
            page = short_name(write_report(folder))
    except Exception as error:  # of whatever kind: no training is lost for its report
        page = f"no report: {' '.join(str(error).split()) or type(error).__name__}"
    best_path = folder / "checkpoints" / "best.ckpt"
    for line in [short_name(best_path), page] if best_path.is_file() else [page]:
        console.print(line, highlight=False, markup=False)
    print_verdict(verdict, console)
    return figures.get("val", {}).get("mse", float("nan"))


def _best_epoch(folder: Path) -> int | None:
    """Of `best.ckpt`, whatever it went by; 1 is the first."""
    path = folder / "checkpoints" / "best.ckpt"
    return read_checkpoint_file(path)["epoch"] + 1 if path.is_file() else None


def read_curves(folder: Path) -> dict[str, dict[int, float]]:
    """`train/loss` and `val/mse` by epoch (1 is the first), of all the run's `metrics*.csv`.

    A resumed run repeats an epoch that was cut off: the later figure counts.
    """
    curves: dict[str, dict[int, float]] = {"train/loss": {}, "val/mse": {}}
    return curves | curves_files.read_curves(folder, curves)
