"""The sections on the training and on the open-loop figures."""

from rich.console import Console

from zoo.report.blocks import Block, Heading, Images, Missing, Rows, Text, gather
from zoo.report.reported_run import ReportedRun
from zoo.runs.table import Table

OPEN_LOOP = (
    "Open-loop figures compare the predicted steering with the recorded steering, row by row. "
    "They do not show whether the car stays on the road."
)


def training_blocks(run: ReportedRun) -> list[Block]:
    """Return the training's duration and curves."""
    return gather((_took, _curves), run)


def open_loop_blocks(run: ReportedRun) -> list[Block]:
    """Return the open-loop figures with two baselines, and plots of predicted against true."""
    return gather((_figures, _scatter), run)


def _took(run: ReportedRun) -> list[Block]:
    epochs, metrics = run.figures("epochs"), run.metrics
    best, rate = metrics.get("best_epoch"), metrics.get("samples_per_second")
    threads = metrics["threads"]
    parts = [
        f"Epochs: {epochs}" + (f" (best: {best})" if best else ""),
        f"Speed: {rate:,.0f} samples/s" if rate else "",
        f"Total time: {metrics['wall_s']:,.0f} s on {metrics['device']} with {threads} "
        + ("thread" if threads == 1 else "threads"),
        f"Training seed: {metrics['seed']}.",
    ]
    return [Text(". ".join(part for part in parts if part))]


def _curves(run: ReportedRun) -> list[Block]:
    image = run.plot(
        "training_curves",
        "Training loss and validation MSE by epoch. The training loss is computed on balanced, "
        "flipped and augmented samples with dropout, so it is usually above the validation MSE.",
        "There are no training curves: no epoch was trained, or the run did not finish.",
    )
    return [Images([image])]


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
        if part and number:
            shown.rows[number - 1].end_section = True
    console.print(shown)


def _figures(run: ReportedRun) -> list[Block]:
    figures, baselines = run.figures("open_loop"), run.figures("baselines")
    table = metrics_table(run.metrics["model"], figures, baselines)
    own = frozenset(number for number, (part, *_) in enumerate(table.cells) if part)
    return [
        Text(
            f"{OPEN_LOOP} The table also has two predictors that ignore the image: one always "
            "predicts zero, the other the mean of the training rows. Balanced MAE is the mean of "
            "the MAEs in 21 steering bins. A positive bias is to the right."
        ),
        Rows(table, left=2, bold=own),
        *_verdict(run),
    ]


def _verdict(run: ReportedRun) -> list[Block]:
    worse = worse_than_nothing(run)
    if not worse:
        return []
    return [Text(f"On {' and '.join(worse)} rows the MSE is not below that of always zero.")]


def worse_than_nothing(run: ReportedRun) -> list[str]:
    """Return the held-out parts whose MSE is not below that of always zero."""
    figures, baselines = run.metrics.get("open_loop") or {}, run.metrics.get("baselines") or {}
    return [
        {"val": "validation", "test": "test"}[part]
        for part in ("val", "test")
        if part in figures and figures[part]["mse"] >= baselines[part]["always zero"]["mse"]
    ]


def _scatter(run: ReportedRun) -> list[Block]:
    images, figures = [], run.figures("open_loop")
    for part in ("val", "test"):
        if part in figures:
            caption = (
                f"{part} rows: predicted against recorded steering, with the line of equality."
            )
            why_not = f"The run has no plot of predicted against recorded steering for {part} rows."
            images.append(run.plot(f"predicted_against_true_{part}", caption, why_not))
    if not images:
        return [Missing("The split has neither validation nor test rows.")]
    return [Heading("Predicted against recorded steering"), Images(images, columns=2)]
