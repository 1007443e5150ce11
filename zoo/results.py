"""`drivezoo results`: print finished runs as a Markdown table."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from zoo.base.command import command
from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import printable
from zoo.cli.closing_lines import print_written
from zoo.cli.run_command import run_command
from zoo.runs.result_files import TableFiles
from zoo.runs.table import Cell, Column, Table
from zoo.runs.table_files import Result, check_table, write_asked

HEADINGS = {  # printed columns by name
    "experiment": "experiment",
    "split": "split",
    "parameters": "parameters",
    "samples_per_second": "samples/s",
    "seconds_per_epoch": "s/epoch",
    "best_epoch": "best of epochs",
    "test_mse": "test MSE (zero, mean)",
    "test_mae": "test MAE (zero, mean)",
    "test_balanced_mae": "test balanced MAE (zero, mean)",
}
SHORT = ("experiment", "parameters", "test_mse", "test_mae")  # in TeX
ERRORS = ("mse", "mae", "balanced_mae")
DRIVING = ("autonomy", "interventions", "cte_mean_m")
# Further figures of a printed column.
PARTS = {f"test_{one}": (f"test_{one}_zero", f"test_{one}_mean") for one in ERRORS}
PARTS["best_epoch"] = ("epochs",)


@dataclass(frozen=True, repr=False)
class FinishedRuns(Result):
    """Finished runs.

    Attributes:
        folders: folder of each run.
        figures: figures of each run by name.
        cells: printed texts of each run.
        written: paths of the files written.
    """

    folders: Sequence[Path]
    figures: Sequence[dict[str, Cell]]
    cells: Sequence[list[str]]
    written: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"FinishedRuns: {', '.join(map(str, self.folders))}"

    def show(self) -> None:
        """Print a row of Markdown for each run."""
        print(f"| {' | '.join(HEADINGS)} |")
        print("|---|---|" + "---:|" * (len(HEADINGS) - 2))
        for row in self.cells:
            print(printable(f"| {' | '.join(row)} |"))
        print_written(self.written)

    def result_table(self) -> Table:
        """Return a row for each run."""
        texts = {name: [row[n] for row in self.cells] for n, name in enumerate(HEADINGS)}
        table = Table.of_figures(self.figures)
        parts = {part for names in PARTS.values() for part in names}
        columns = []
        for one in table.columns:
            if one.name in texts:
                names = (one.name, *PARTS.get(one.name, ()))
                figures = {name: table.figures[name] for name in names}
                one = Column(one.name, HEADINGS[one.name], texts[one.name], figures)
            if one.name not in parts:
                columns.append(replace(one, short=one.name in SHORT))
        return Table(columns, "Errors of the steering; in brackets: always zero, the mean.")


@command
def results(
    *run_folder: str | Path, metrics: bool = False, tables: TableFiles
) -> FinishedRuns | None:
    """Print finished runs as a Markdown table.

    Each run has a row: parameters, samples per second, and test errors. In brackets are the errors
    of two baselines: steering always zero, and always the mean.

    Args:
        *run_folder: folders of finished runs.
        metrics: true: print the definitions of a drive's metrics instead (docs/metrics.md).
        tables: see `TableFiles`.

    Raises:
        InputError: a folder has no figures of a finished run.
    """
    if metrics:
        from zoo.drives.metrics_page import metrics_page

        print(metrics_page(), end="")
        return None
    if not run_folder:
        raise UsageError(f"name the folders of finished runs; usage: {results.usage}")
    check_table(tables.table, tables.columns)
    runs = read_finished(run_folder)
    runs.written.extend(write_asked(runs, tables.table, columns=tables.columns))
    return runs


def read_finished(folders: Sequence[str | Path]) -> FinishedRuns:
    """Return the figures of finished runs.

    Raises:
        InputError: a folder has no figures of a finished run, or they are damaged.
    """
    figures, cells = [], []
    for folder in folders:
        try:
            figures.append(run_figures(Path(folder)))
            cells.append(run_cells(figures[-1]))
        except (KeyError, TypeError, AttributeError) as error:  # another version wrote the run
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise InputError(f"{folder}: its figures or config are damaged ({reason})") from None
    return FinishedRuns([Path(one) for one in folders], figures, cells)


def run_figures(folder: Path) -> dict[str, Cell]:
    """Return a run's figures by name, those of its drives with the track's name in front."""
    from zoo.runs.config_files import load_config, read_hydra_file
    from zoo.runs.metrics_file import read_metrics_file

    path = folder / "metrics.json"
    if not path.is_file():
        raise InputError(f"{folder}: has no metrics.json; name a finished run")
    metrics = read_metrics_file(folder)
    if metrics.get("open_loop") is None and metrics.get("tracks"):
        raise InputError(
            f"{folder}: is an evaluation, not a run; rank evaluations: drivezoo leaderboard "
            f"{shlex.quote(str(folder.parent))}"
        )
    config = load_config(folder)
    name = read_hydra_file(folder).choices.experiment or metrics["model"]
    found: dict[str, Cell] = {
        "run": str(folder),
        "experiment": f"{name}, quick" if config.quick else name,
        "seed": metrics.get("seed"),
        "split": str(config.data.split),
        "parameters": metrics["parameters"],
        "samples_per_second": metrics["samples_per_second"],
        "seconds_per_epoch": metrics["seconds_per_epoch"],
        "best_epoch": metrics["best_epoch"],
        "epochs": metrics["epochs"],
        "val_mse": metrics["open_loop"].get("val", {}).get("mse"),
    }
    if "test" in metrics["open_loop"]:
        for figure in ERRORS:
            found[f"test_{figure}"] = metrics["open_loop"]["test"][figure]
            zero, mean = (one[figure] for one in metrics["baselines"]["test"].values())
            found |= {f"test_{figure}_zero": zero, f"test_{figure}_mean": mean}
    for track, one in ((metrics.get("drive") or {}).get("tracks") or {}).items():
        for figure in DRIVING:
            value, deviation = (one or {}).get(figure) or (None, None)
            found |= {f"{track}_{figure}": value, f"{track}_{figure}_std": deviation}
    return found


def run_cells(figures: dict[str, Cell]) -> list[str]:
    """Return the texts of a run's row."""
    cells = [
        str(figures["experiment"]),
        str(figures["split"]),
        f"{figures['parameters']:,}",
        _figure(figures["samples_per_second"], ",.0f"),
        _figure(figures["seconds_per_epoch"], ".1f"),
        f"{figures['best_epoch']} of {figures['epochs']}",
    ]
    for name in (f"test_{figure}" for figure in ERRORS):
        if name not in figures:
            cells.append("no test rows")
            continue
        own, zero, mean = (figures[key] for key in (name, f"{name}_zero", f"{name}_mean"))
        cells.append(f"{own:.4f} ({zero:.4f}, {mean:.4f})")
    return cells


def _figure(value: float | None, form: str) -> str:
    """Format a value; a dash for None, as in a resumed run that had nothing left to train."""
    return "-" if value is None else format(value, form)


if __name__ == "__main__":
    sys.exit(run_command("zoo.results", results.main, sys.argv[1:]))
