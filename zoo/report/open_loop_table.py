"""The table of open-loop figures, for the terminal and the report."""

from rich.table import Table
from rich.text import Text


def metrics_table(name: str, figures: dict, baselines: dict) -> Table:
    """Return a table of open-loop figures of the network, of always zero and of the mean.

    Args:
        name: network's name.
        figures: figures by part of the split.
        baselines: figures by part of the split and predictor.
    """
    table = Table(title="steering, centre camera, best checkpoint", title_justify="left")
    for column in ("rows", "predictor", "MSE", "MAE", "balanced MAE", "bias"):
        table.add_column(column, justify="left" if column in ("rows", "predictor") else "right")
    for part, own in figures.items():
        for predictor, row in {name: own, **baselines[part]}.items():
            values = [row[key] for key in ("mse", "mae", "balanced_mae", "bias")]
            texts = [f"{value:.4f}" for value in values[:3]] + [f"{values[3]:+.4f}"]
            style = "bold" if predictor == name else "dim"
            # A model's name comes from the user: do not read it as markup.
            table.add_row(part if predictor == name else "", Text(predictor), *texts, style=style)
        table.add_section()
    return table
