"""The section on the training, and on what came out of it open-loop."""

from zoo.report.blocks import Block, Heading, Missing, Pictures, Rows, Text, gather
from zoo.report.reported_run import Run

SAYS_LITTLE = (
    "Open-loop figures say how near the predicted steering is to the recorded one, row by row. "
    "They do not say whether the car stays on the road."
)


def training_blocks(run: Run) -> list[Block]:
    """Curves, and how long it took."""
    return gather((_took, _curves), run)


def open_loop_blocks(run: Run) -> list[Block]:
    """Predicted against true, and the figures beside those of two that look at nothing."""
    return gather((_figures, _scatter), run)


def _took(run: Run) -> list[Block]:
    epochs, metrics = run.figures("epochs"), run.metrics
    best = f"the best after epoch {metrics['best_epoch']}" if metrics.get("best_epoch") else ""
    rate = metrics.get("samples_per_second")
    parts = [
        f"{epochs} epoch{_s(epochs)}" + (f", {best}" if best else ""),
        f"{rate:,.0f} samples/s" if rate else "",
        f"{metrics['wall_s']:,.0f} s in all",
        f"on {metrics['device']} with {metrics['threads']} thread{_s(metrics['threads'])}",
        f"training seed {metrics['seed']}",
    ]
    return [Text("; ".join(part for part in parts if part) + ".")]


def _s(count: int) -> str:
    return "" if count == 1 else "s"


def _curves(run: Run) -> list[Block]:
    picture = run.plot(
        "training_curves",
        "Training loss and validation MSE by epoch. The training loss is over balanced, flipped "
        "and augmented samples with dropout on: as a rule it is above the validation's.",
        "There are no training curves: no epoch was trained, or the run did not finish.",
    )
    return [Pictures([picture])]


def _figures(run: Run) -> list[Block]:
    from zoo.report.open_loop_table import metrics_table

    figures, baselines = run.figures("open_loop"), run.figures("baselines")
    table = metrics_table(run.metrics["model"], figures, baselines)
    own = frozenset(range(0, 3 * len(figures), 3))
    return [
        Text(
            f"{SAYS_LITTLE} Beside each stands what two would get that look at nothing: one that "
            "always says zero, one that always says the training rows' mean. Balanced MAE is the "
            "mean of the MAE in each of 21 steering bins; the bias is positive to the right."
        ),
        Rows.of(table, left=2, bold=own),
        *_verdict(run),
    ]


def _verdict(run: Run) -> list[Block]:
    worse = worse_than_nothing(run)
    if not worse:
        return []
    return [Text(f"On {' and '.join(worse)} rows the MSE is no better than that of always zero.")]


def worse_than_nothing(run: Run) -> list[str]:
    """Of `val` and `test`, those on which the MSE is not below that of always zero."""
    figures, baselines = run.metrics.get("open_loop") or {}, run.metrics.get("baselines") or {}
    return [
        {"val": "validation", "test": "test"}[part]
        for part in ("val", "test")
        if part in figures and figures[part]["mse"] >= baselines[part]["always zero"]["mse"]
    ]


def _scatter(run: Run) -> list[Block]:
    pictures, figures = [], run.figures("open_loop")
    for part in ("val", "test"):
        if part in figures:
            caption = f"{part}: predicted against recorded steering, with the line of equality."
            why_not = f"The run drew no predicted against true for its {part} rows."
            pictures.append(run.plot(f"predicted_against_true_{part}", caption, why_not))
    if not pictures:
        return [Missing("There are neither validation nor test rows to predict.")]
    return [Heading("Predicted against true"), Pictures(pictures, columns=2)]
