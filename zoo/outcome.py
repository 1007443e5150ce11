"""What a training has come to: figures, table and plots of its best checkpoint."""

import csv
import json
import platform
import time
from importlib.metadata import version
from pathlib import Path

import lightning
import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.table import Table

from datamodules.driving import DrivingData
from datamodules.findings import find_oddities
from datamodules.split import PARTS
from zoo import plots
from zoo.callbacks.closed_loop import best_drive
from zoo.checkpoint import read_checkpoint_file
from zoo.code_fingerprint import code_fingerprint
from zoo.console_progress import working
from zoo.open_loop import baseline_metrics, open_loop_metrics, predict_steering, side_response
from zoo.report import write_report
from zoo.scoring.candidates import Choice
from zoo.scoring.tracks import RunScore, score_run
from zoo.steering_module import SteeringModule
from zoo.verdict.evidence import Evidence, read_overrides
from zoo.verdict.judgement import judge, print_verdict
from zoo.whole_file import write_whole

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
    evidence = Evidence(
        str(folder / "checkpoints" / "best.ckpt"),
        OmegaConf.to_container(config, resolve=True),
        metrics,
        read_overrides(folder),
    )
    verdict = judge(drive["drives"] if drive else [], evidence)
    metrics["verdict"] = verdict.plain()
    write_whole(folder / "metrics.json", json.dumps(_without_nan(metrics), indent=2))
    if seconds:
        console.print(
            f"{trainer.current_epoch} epochs, {samples / seconds:,.0f} samples/s, "
            f"{metrics['wall_s']:.0f} s in all" + (f"; best after epoch {best}" if best else ""),
            highlight=False,
        )
    try:
        with working("writing the report", console):
            page = str(write_report(folder))
    except Exception as error:  # of whatever kind: no training is lost for its report
        page = f"no report: {' '.join(str(error).split()) or type(error).__name__}"
    best_path = folder / "checkpoints" / "best.ckpt"
    for line in [best_path, page] if best_path.is_file() else [page]:
        console.print(str(line), highlight=False, markup=False)
    print_verdict(verdict, console)
    return figures.get("val", {}).get("mse", float("nan"))


def _best_epoch(folder: Path) -> int | None:
    """Of `best.ckpt`, whatever it went by; 1 is the first."""
    path = folder / "checkpoints" / "best.ckpt"
    return read_checkpoint_file(path)["epoch"] + 1 if path.is_file() else None


def metrics_table(name: str, figures: dict, baselines: dict) -> Table:
    """Open-loop figures of the network beside those of always zero and the mean."""
    table = Table(title="steering, centre camera, best checkpoint", title_justify="left")
    for column in ("rows", "predictor", "MSE", "MAE", "balanced MAE", "bias"):
        table.add_column(column, justify="left" if column in ("rows", "predictor") else "right")
    for part, own in figures.items():
        for predictor, row in {name: own, **baselines[part]}.items():
            values = [row[key] for key in ("mse", "mae", "balanced_mae", "bias")]
            texts = [f"{value:.4f}" for value in values[:3]] + [f"{values[3]:+.4f}"]
            style = "bold" if predictor == name else "dim"
            table.add_row(part if predictor == name else "", predictor, *texts, style=style)
        table.add_section()
    return table


def read_curves(folder: Path) -> dict[str, dict[int, float]]:
    """`train/loss` and `val/mse` by epoch (1 is the first), of all the run's `metrics*.csv`.

    A resumed run repeats an epoch that was cut off: the later figure counts.
    """
    curves: dict[str, dict[int, float]] = {"train/loss": {}, "val/mse": {}}
    earlier = sorted(folder.glob("metrics.*.csv"), key=lambda path: int(path.stem.split(".")[1]))
    for path in [*earlier, folder / "metrics.csv"]:
        if not path.is_file():
            continue
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                for name, curve in curves.items():
                    if row.get(name):
                        curve[int(row["epoch"]) + 1] = float(row[name])
    return curves


def _without_nan(value: object) -> object:
    """JSON has no NaN: null stands for it."""
    if isinstance(value, dict):
        return {key: _without_nan(one) for key, one in value.items()}
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
