"""The sections on the training and on the open-loop figures."""

from rich.console import Console

from zoo.base.errors import InputError
from zoo.report.blocks import Block, Heading, Images, Rows, Text
from zoo.report.reported_run import ReportedRun
from zoo.runs.table import Table

OPEN_LOOP = (
    "Predicted and recorded steering, row by row; this does not show whether the car stays on the "
    "road. Always zero and the mean of the training rows ignore the image. Balanced MAE is the "
    "mean of the MAEs in 21 steering bins. A positive bias is to the right."
)


def duration(run: ReportedRun) -> list[Block]:
    """Return the training's epochs, speed and duration."""
    epochs, metrics = run.figures("epochs"), run.metrics
    return [
        Text(
            f"Epochs: {epochs} (best: {metrics.get('best_epoch') or '-'}). Samples per second: "
            f"{metrics.get('samples_per_second') or 0:,.0f}. Total time: {metrics['wall_s']:,.0f} "
            f"s on {metrics['device']}; threads: {metrics['threads']}. Training seed: "
            f"{metrics['seed']}."
        )
    ]


def curves(run: ReportedRun) -> list[Block]:
    """Return the training's curves."""
    caption = (
        "Training loss and validation MSE by epoch. The training loss is computed on balanced, "
        "flipped and augmented samples with dropout, so it is usually above the validation MSE."
    )
    return [Images([run.plot("training_curves", caption)])]


def open_loop(run: ReportedRun) -> list[Block]:
    """Return the open-loop figures with those of two baselines."""
    figures, baselines = run.figures("open_loop"), run.figures("baselines")
    table = metrics_table(run.metrics["model"], figures, baselines)
    own = frozenset(number for number, (part, *_) in enumerate(table.cells) if part)
    worse = worse_than_nothing(run)
    return [Text(OPEN_LOOP), Rows(table, left=2, bold=own), *([Text(worse)] if worse else [])]


def scatter(run: ReportedRun) -> list[Block]:
    """Return plots of predicted against recorded steering."""
    figures = run.figures("open_loop")
    images = [
        run.plot(f"predicted_against_true_{part}", f"{part} rows, with the line of equality.")
        for part in ("val", "test")
        if part in figures
    ]
    if not images:
        raise InputError("The split has neither validation nor test rows.")
    return [Heading("Predicted against recorded steering"), Images(images, columns=2)]


def metrics_table(name: str, figures: dict, baselines: dict) -> Table:
    """Return a table of open-loop figures of the network, of always zero and of the mean.

    Args:
        name: network's name.
        figures: figures by part of the split.
        baselines: figures by part of the split and predictor.
    """
    rows = []
    for part, own in figures.items():
        for predictor, row in {name: own, **baselines[part]}.items():
            texts = [f"{row[key]:.4f}" for key in ("mse", "mae", "balanced_mae")]
            shown = part if predictor == name else ""
            rows.append([shown, predictor, *texts, f"{row['bias']:+.4f}"])
    return Table.of(["rows", "predictor", "MSE", "MAE", "balanced MAE", "bias"], rows)


def print_metrics(table: Table, console: Console) -> None:
    """Print `metrics_table`; a part of the split begins with the network's row."""
    title = "steering, centre camera, best checkpoint"
    shown = table.printed(left=2, title=title, title_justify="left")
    for number, (part, *_) in enumerate(table.cells):
        shown.rows[number].style = "bold" if part else "dim"
    console.print(shown)


def worse_than_nothing(run: ReportedRun) -> str:
    """Return a sentence on the parts whose MSE is not below that of always zero; empty for none."""
    figures, baselines = run.metrics.get("open_loop") or {}, run.metrics.get("baselines") or {}
    worse = [
        part
        for part in ("val", "test")
        if part in figures and figures[part]["mse"] >= baselines[part]["always zero"]["mse"]
    ]
    if not worse:
        return ""
    return (
        f"On {' and '.join(worse)} rows its MSE is not below that of always zero, a predictor that "
        "ignores the image. This does not show how it drives."
    )
