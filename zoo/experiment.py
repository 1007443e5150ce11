"""One experiment: load, train, test, report. The main job."""

import json
import platform
import shlex
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
from datamodules.errors import InputError
from datamodules.split import PARTS, write_split
from zoo import plots
from zoo.build import apply_quick, build_data, build_module, build_trainer
from zoo.checkpoint import make_card, read_checkpoint_file
from zoo.open_loop import baseline_metrics, open_loop_metrics, predict_steering
from zoo.status import StoppedError, is_first_process, run_status
from zoo.steering_module import SteeringModule

PACKAGES = ("drivezoo", "torch", "lightning", "albumentations", "opencv-python-headless", "numpy")


def run_experiment(config: DictConfig, folder: Path, resume: bool = False) -> float:
    """Run what `config` says in `folder`; with `resume`, from its last checkpoint.

    Returns the validation MSE of the best checkpoint (NaN without validation rows), which a
    sweeper can minimise.

    Raises:
        InputError: anything wrong with the config, the recording or a file.
        StoppedError: on Ctrl-C.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with run_status(folder):
        started = time.perf_counter()
        console = Console(soft_wrap=True, quiet=not is_first_process())
        apply_quick(config)
        data = build_data(config)
        data.load(console)
        card = make_card(
            OmegaConf.to_container(config, resolve=True),
            data.view,
            {"fingerprint": data.recording.fingerprint(), "rows": len(data.recording)},
        )
        module = build_module(config, data, card)
        last = folder / "checkpoints" / "last.ckpt"
        start = _checked_last(last, card) if resume and last.is_file() else None
        if start is None and config.model.weights is not None:
            from zoo.weights import load_weights

            said = load_weights(module.network, str(config.model.weights))
            console.print(f"weights: {said}", highlight=False, markup=False)
        write_split(folder / "split.csv", data.recording, data.split)
        trainer = build_trainer(config, folder, has_validation=len(data.split.val) > 0)
        _say_what_runs(console, config, module, data, trainer)
        _fit(trainer, module, data, start, folder)
        if not trainer.is_global_zero:
            return float("nan")
        _take_best(module, folder)
        return _finish(config, folder, module, data, trainer, console, started)


def _checked_last(last: Path, card: dict) -> Path:
    """The checkpoint to resume from, read once without running anything in it."""
    before = read_checkpoint_file(last)["drivezoo"]
    if before["data"] != card["data"]:
        raise InputError(
            f"{last}: was trained on {before['data']['rows']} rows "
            f"({before['data']['fingerprint']}), data.root now holds {card['data']['rows']} "
            f"({card['data']['fingerprint']}); bring the recording back, or start a new run with "
            f"model.weights={last}"
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
        *_leak_lines(data),
    ):
        console.print(line, highlight=False, markup=False)


def _leak_lines(data: DrivingData) -> list[str]:
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
    except OSError as error:
        raise InputError(
            f"{folder}: cannot write the run ({error.strerror or error}); what was saved before is "
            f"kept; free some space and go on with: {_resume_command(folder)}"
        ) from error
    except SystemExit:
        if not trainer.interrupted:
            raise
    except KeyboardInterrupt:
        pass
    if trainer.interrupted:
        done = f"the epochs before {trainer.current_epoch + 1} are saved"
        if not last.is_file():
            done = "no epoch was complete yet"
        raise StoppedError(f"stopped; {done}; go on with: {_resume_command(folder)}")
    if trainer.max_epochs == 0:  # nothing to learn: only carry the weights over to a checkpoint
        for name in ("best", "last"):
            trainer.save_checkpoint(folder / "checkpoints" / f"{name}.ckpt")


def _resume_command(folder: Path) -> str:
    return shlex.join(["python", "-m", "zoo", f"resume={folder}"])


def _take_best(module: SteeringModule, folder: Path) -> None:
    best = folder / "checkpoints" / "best.ckpt"
    if best.is_file():
        module.load_state_dict(read_checkpoint_file(best)["state_dict"])


def _finish(
    config: DictConfig,
    folder: Path,
    module: SteeringModule,
    data: DrivingData,
    trainer: lightning.Trainer,
    console: Console,
    started: float,
) -> float:
    """Figures, table and plots of the best checkpoint."""
    train_mean = float(data.recording.steering[data.split.train].mean())
    figures, baselines = {}, {}
    for part in PARTS:
        rows = getattr(data.split, part)
        if not len(rows):
            continue
        predicted = predict_steering(module, data.evaluation_batches(part))
        true = data.recording.steering[rows]
        figures[part] = open_loop_metrics(predicted, true)
        baselines[part] = baseline_metrics(true, train_mean)
        if part != "train":
            figure = plots.predicted_against_true(predicted, true, f"{part}, best checkpoint")
            plots.save_figure(figure, folder / "plots" / f"predicted_against_true_{part}.png")
    zero = baselines.get("val", baselines["train"])["always zero"]["mse"]
    curves = read_curves(folder / "metrics.csv")
    if curves["train/loss"]:
        figure = plots.training_curves(curves["train/loss"], curves["val/mse"], zero)
        plots.save_figure(figure, folder / "plots" / "training_curves.png")
    samples, seconds = module.train_samples, module.train_seconds
    epochs = max(len(curves["train/loss"]), 1)
    best = min(curves["val/mse"], key=curves["val/mse"].get) if curves["val/mse"] else None
    metrics = {
        "model": config.model.name,
        "parameters": sum(p.numel() for p in module.network.parameters()),
        "open_loop": figures,
        "baselines": baselines,
        "leak": {part: vars(leak) for part, leak in data.measured_leaks.items()},
        "epochs": trainer.current_epoch,
        "best_epoch": best,
        "samples_per_second": samples / seconds if seconds else None,
        "seconds_per_epoch": seconds / epochs if seconds else None,
        "wall_s": time.perf_counter() - started,
        "seed": config.seed,
        "device": str(trainer.strategy.root_device),
        "threads": torch.get_num_threads(),
        "data": {
            "fingerprint": data.recording.fingerprint(),
            "rows": len(data.recording),
            "split": {part: len(getattr(data.split, part)) for part in PARTS},
        },
        "versions": {"python": platform.python_version()}
        | {package: version(package) for package in PACKAGES},
    }
    (folder / "metrics.json").write_text(json.dumps(_without_nan(metrics), indent=2))
    console.print(metrics_table(config.model.name, figures, baselines))
    if seconds:
        console.print(
            f"{trainer.current_epoch} epochs, {samples / seconds:,.0f} samples/s, "
            f"{metrics['wall_s']:.0f} s in all" + (f"; best after epoch {best}" if best else ""),
            highlight=False,
        )
    console.print(f"{folder / 'checkpoints' / 'best.ckpt'}\n{folder / 'plots'}", highlight=False)
    return figures.get("val", {}).get("mse", float("nan"))


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


def read_curves(path: Path) -> dict[str, dict[int, float]]:
    """`train/loss` and `val/mse` by epoch (1 is the first), of the run's `metrics.csv`.

    A resumed run repeats an epoch that was cut off: the later figure counts.
    """
    import csv

    curves: dict[str, dict[int, float]] = {"train/loss": {}, "val/mse": {}}
    if path.is_file():
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
