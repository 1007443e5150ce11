"""Evaluate a run's best checkpoint; plot, drive, write and print the results."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from datamodules.looking.findings import find_oddities
from datamodules.run_data import RunData
from datamodules.split import PARTS
from zoo.base.console_progress import working
from zoo.base.terminal import counted, print_line, print_written
from zoo.checkpoints.checkpoint_path import short_name
from zoo.runs import plots
from zoo.runs.code_fingerprint import code_fingerprint, package_versions
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.run_record import Run
from zoo.scoring.evidence import evidence_of_run
from zoo.scoring.training_section import metrics_table, print_metrics
from zoo.scoring.verdict import Verdict, judge, print_verdict
from zoo.scoring.write_up import write_report
from zoo.training.open_loop import (
    baseline_metrics,
    open_loop_metrics,
    predict_steering,
    side_response,
)
from zoo.training.run_module import RunModule


@dataclass(frozen=True)
class OpenLoop:
    """The open-loop evaluation of a run's network, by part of the split.

    Attributes:
        figures: see `open_loop_metrics`.
        baselines: the same figures of networks that ignore the image.
        responses: recovery response of `val` and `test`, see `side_response`.
        steering: predicted and true, float32 [N] each, of `val` and `test`.
    """

    figures: dict[str, dict]
    baselines: dict[str, dict]
    responses: dict[str, float | None]
    steering: dict[str, tuple[np.ndarray, np.ndarray]]


def evaluate_rows(module: RunModule, data: RunData, console: Console) -> OpenLoop:
    """Predict each part's rows; of `val` and `test` also the side cameras' rows."""
    train_mean = float(data.steering_of(data.split.train).mean())
    open_loop = OpenLoop({}, {}, {}, {})
    for part in PARTS:
        batches = data.evaluation_batches(part)
        if not len(batches.rows):
            continue
        with working(f"predicting {part} rows", console):
            predicted = predict_steering(module, batches)
            true = data.steering_of(batches.rows)
            open_loop.figures[part] = open_loop_metrics(predicted, true)
            open_loop.baselines[part] = baseline_metrics(true, train_mean)
            if part != "train":
                sides = (predict_steering(module, side) for side in batches.sides())
                open_loop.responses[part] = side_response(*sides)
                open_loop.steering[part] = predicted, true
    return open_loop


def save_plots(open_loop: OpenLoop, folder: Path, console: Console) -> None:
    """Plot predicted against true steering, and the losses by epoch, in `folder/plots`."""
    with working("plotting", console):
        for part, (predicted, true) in open_loop.steering.items():
            figure = plots.predicted_against_true(predicted, true, f"{part}, best checkpoint")
            plots.save_figure(figure, folder / "plots" / f"predicted_against_true_{part}.png")
        curves, baselines = read_curves(folder), open_loop.baselines
        zero = baselines.get("val", baselines["train"])["always zero"]["mse"]
        if curves["train/loss"]:
            figure = plots.training_curves(curves["train/loss"], curves["val/mse"], zero)
            plots.save_figure(figure, folder / "plots" / "training_curves.png")


def print_open_loop(open_loop: OpenLoop, name: str, console: Console) -> None:
    """Print the table of a network's open-loop figures."""
    print_metrics(metrics_table(name, open_loop.figures, open_loop.baselines), console)
    zeros = {part: baseline["always zero"]["mae"] for part, baseline in open_loop.baselines.items()}
    if worse := [part for part, row in open_loop.figures.items() if row["mae"] > zeros[part]]:
        print_line(
            console,
            f"MAE above that of always zero ({', '.join(worse)} rows): where recorded steering is "
            "near 0, any steering costs; compare the balanced MAE, which counts bends as much",
        )
    if (response := open_loop.responses.get("test")) is not None:
        print_line(
            console,
            f"recovery response, test rows: {response:+.3f} (above 0: steers back)",
        )


def write_metrics(
    folder: Path,
    card: dict,
    data: RunData,
    module: RunModule,
    open_loop: OpenLoop,
    fields: dict,
) -> tuple[dict, Verdict]:
    """Write `metrics.json`; return it and the verdict that it holds.

    Args:
        folder: run's folder.
        card: see `zoo.checkpoints.checkpoint.make_card`.
        data: data that it was trained on.
        module: module with the best checkpoint's weights.
        open_loop: open-loop evaluation.
        fields: further fields of the file.
    """
    samples, seconds, epochs = module.train_samples, module.train_seconds, module.train_epochs
    trained, choice = module.trainer.current_epoch, fields["choice"] or {}
    metrics = {
        "model": card["config"]["model"]["name"],
        "parameters": sum(p.numel() for p in module.network.parameters()),
        "open_loop": open_loop.figures,
        "side_response": open_loop.responses,
        "baselines": open_loop.baselines,
        "epochs": trained,
        "train_samples": samples * trained // max(epochs, 1),
        "best_epoch": choice.get("epoch") or None,  # not 0, of the initial weights
        "samples_per_second": samples / seconds if seconds else None,
        "seconds_per_epoch": seconds / epochs if seconds else None,
        "seed": card["config"]["seed"],
        "data": {
            **{key: value for key, value in card["data"].items() if key != "row_hashes"},
            "split": {part: len(getattr(data.split, part)) for part in PARTS},
        },
        "findings": [vars(oddity) for oddity in find_oddities(data.recording)],
        "code": code_fingerprint(),
        "versions": package_versions()
        | {part["name"]: part["sha256"] for part in card.get("parts", ())},
        **fields,
    }
    drive = metrics["drive"] or {}
    evidence = evidence_of_run(folder, card["config"], metrics)
    verdict = judge(drive.get("drives", []), evidence, replayed=drive.get("replayed"))
    metrics["verdict"] = verdict.plain()
    write_metrics_file(folder, metrics)
    return metrics, verdict


def print_conclusion(
    folder: Path, metrics: dict, verdict: Verdict | None, console: Console
) -> None:
    """Write the report; print the training's cost, the files written and the verdict, if any."""
    best = metrics["best_epoch"]
    if metrics["samples_per_second"]:
        print_line(
            console,
            f"{counted(metrics['epochs'], 'epoch')}, "
            f"{metrics['samples_per_second']:,.0f} samples/s, {metrics['wall_s']:.0f} s total"
            + (f"; best after epoch {best}" if best else ""),
        )
    written = [*folder.glob("checkpoints/best.ckpt")]
    try:
        with working("writing the report", console):
            written.append(write_report(folder))
    except Exception as error:  # any error: the training is complete, and must not be lost
        reason = " ".join(str(error).split()) or type(error).__name__
        print_line(console, f"report not written: {reason}")
    print_written(map(short_name, written), console=console)
    if verdict:
        print_verdict(verdict, console)


def read_curves(folder: Path) -> dict[str, dict[int, float]]:
    """Return `train/loss` and `val/mse` by epoch (from 1), from the run's `metrics*.csv`.

    A resumed run repeats the interrupted epoch: its later figure counts.
    """
    curves: dict[str, dict[int, float]] = {"train/loss": {}, "val/mse": {}}
    return curves | Run(folder).curves(curves)
