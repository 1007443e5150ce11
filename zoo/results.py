"""`python -m zoo.results RUN_FOLDER...`: finished runs side by side, as a Markdown table.

With `--metrics`, the page of all metrics of a drive, `docs/metrics.md`.
"""

import sys
from pathlib import Path

from datamodules.errors import InputError, UsageError
from datamodules.terminal import printable
from zoo.cli.arguments import is_help
from zoo.cli.run_command import run_command

METRICS = "--metrics"
USAGE = f"usage: python -m zoo.results RUN_FOLDER... | {METRICS}"
HELP = f"""{USAGE}

Prints a Markdown table of finished runs, a row for each: parameters, samples per second, and the
test figures beside those of always zero and of the mean.

  {METRICS}   print docs/metrics.md instead: the definition of each metric of a drive"""
HEADER = (
    "experiment | split | parameters | samples/s | s/epoch | best of epochs "
    "| test MSE (zero, mean) | test MAE (zero, mean) | test balanced MAE (zero, mean)"
)


def print_results(arguments: list[str]) -> None:
    """Print a row for each run's folder, or the page of metrics.

    Raises:
        InputError: a folder without the figures of a finished run.
    """
    if is_help(arguments):
        print(HELP)
        return
    if arguments == [METRICS]:
        from zoo.drives.metrics_page import metrics_page

        print(metrics_page(), end="")
        return
    if not arguments:
        raise UsageError(f"name the folders of finished runs; {USAGE}")
    rows = []
    for folder in arguments:
        try:
            rows.append(result_row(Path(folder)))
        except (KeyError, TypeError, AttributeError) as error:  # of another version
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise InputError(f"{folder}: its figures or config are damaged ({reason})") from None
    print(f"| {HEADER} |")
    print("|---|---|" + "---:|" * (HEADER.count("|") - 1))
    for row in rows:
        print(printable(row))


def result_row(folder: Path) -> str:
    """One Markdown row: a figure, and in brackets those of always zero and of the mean."""
    from zoo.runs.config_files import load_config, read_hydra_file
    from zoo.runs.metrics_file import read_metrics_file

    path = folder / "metrics.json"
    if not path.is_file():
        raise InputError(f"{folder}: holds no metrics.json; only a finished run has figures")
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
    """A dash for what was not measured, as where a resumed run had nothing left to train."""
    return "-" if value is None else format(value, form)


if __name__ == "__main__":
    sys.exit(run_command("zoo.results", print_results, sys.argv[1:]))
