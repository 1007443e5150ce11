"""`python -m zoo.results [RUN_FOLDER...] [key=value ...]`: print finished runs as a Markdown table.

Each run has a row: parameters, samples per second, and test errors. In brackets are the errors of
two baselines: steering always zero, and always the mean.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from datamodules.errors import InputError, UsageError
from datamodules.terminal import printable
from zoo.cli.command import Command
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__, {"[RUN_FOLDER...]": "folders of finished runs"})
HEADER = (
    "experiment | split | parameters | samples/s | s/epoch | best of epochs "
    "| test MSE (zero, mean) | test MAE (zero, mean) | test balanced MAE (zero, mean)"
)


@dataclass(frozen=True, kw_only=True)
class ResultsOptions:
    """Options of the table; `conf/results.yaml` has their meanings and defaults."""

    metrics: bool


def print_results(arguments: list[str]) -> None:
    """Print a row for each run's folder, or the page of metrics.

    Raises:
        InputError: a folder has no figures of a finished run.
    """
    folders, options = COMMAND.read(arguments, ResultsOptions)
    if options.metrics:
        from zoo.drives.metrics_page import metrics_page

        print(metrics_page(), end="")
        return
    if not folders:
        raise UsageError(f"name the folders of finished runs; usage: {COMMAND.usage}")
    rows = []
    for folder in folders:
        try:
            rows.append(result_row(Path(folder)))
        except (KeyError, TypeError, AttributeError) as error:  # another version wrote the run
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise InputError(f"{folder}: its figures or config are damaged ({reason})") from None
    print(f"| {HEADER} |")
    print("|---|---|" + "---:|" * (HEADER.count("|") - 1))
    for row in rows:
        print(printable(row))


def result_row(folder: Path) -> str:
    """Return a run's row of the Markdown table."""
    from zoo.runs.config_files import load_config, read_hydra_file
    from zoo.runs.metrics_file import read_metrics_file

    path = folder / "metrics.json"
    if not path.is_file():
        raise InputError(f"{folder}: has no metrics.json; name a finished run")
    metrics = read_metrics_file(folder)
    config = load_config(folder)
    name = read_hydra_file(folder).choices.experiment or metrics["model"]
    if config.quick:
        name += ", quick"
    cells = [
        name,
        str(config.data.split),
        f"{metrics['parameters']:,}",
        _figure(metrics["samples_per_second"], ",.0f"),
        _figure(metrics["seconds_per_epoch"], ".1f"),
        f"{metrics['best_epoch']} of {metrics['epochs']}",
    ]
    for figure in ("mse", "mae", "balanced_mae"):
        if "test" not in metrics["open_loop"]:
            cells.append("no test rows")
            continue
        own = metrics["open_loop"]["test"][figure]
        zero, mean = (b[figure] for b in metrics["baselines"]["test"].values())
        cells.append(f"{own:.4f} ({zero:.4f}, {mean:.4f})")
    return f"| {' | '.join(cells)} |"


def _figure(value: float | None, form: str) -> str:
    """Format a value; a dash for None, as in a resumed run that had nothing left to train."""
    return "-" if value is None else format(value, form)


if __name__ == "__main__":
    sys.exit(run_command("zoo.results", print_results, sys.argv[1:]))
