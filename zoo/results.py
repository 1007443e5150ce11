"""`drivezoo results`: print finished runs as a Markdown table."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from zoo.base.command import command
from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import printable
from zoo.cli.closing_lines import print_written
from zoo.runs.result_files import TableFiles
from zoo.runs.run import Run
from zoo.runs.table import Cell, Column, Table
from zoo.runs.table_files import Result, check_table, write_asked

SHORT = ("experiment", "parameters", "test_mse", "test_mae")  # in TeX
ERRORS = ("mse", "mae", "balanced_mae")
DRIVING = ("autonomy", "interventions", "cte_mean_m")
# Printed columns by name: heading, format, and the names of further figures in the format.
PRINTED = {
    "experiment": ("experiment", "{}", ()),
    "split": ("split", "{}", ()),
    "parameters": ("parameters", "{:,}", ()),
    "samples_per_second": ("samples/s", "{:,.0f}", ()),
    "seconds_per_epoch": ("s/epoch", "{:.1f}", ()),
    "best_epoch": ("best of epochs", "{} of {}", ("epochs",)),
    **{
        f"test_{error}": (
            f"test {label} (zero, mean)",
            "{:.4f} ({:.4f}, {:.4f})",
            (f"test_{error}_zero", f"test_{error}_mean"),
        )
        for error, label in zip(ERRORS, ("MSE", "MAE", "balanced MAE"), strict=True)
    },
}


@dataclass(frozen=True, repr=False)
class FinishedRuns(Result):
    """Finished runs.

    Attributes:
        runs: the runs.
        figures: figures of each run by name.
        written: paths of the files written.
    """

    runs: Sequence[Run]
    figures: Sequence[dict[str, Cell]]
    written: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"FinishedRuns: {', '.join(str(run.folder) for run in self.runs)}"

    def printed_table(self) -> Table:
        """Return a row for each run with the printed columns."""
        columns = []
        for name, (heading, form, parts) in PRINTED.items():
            texts = []
            for figures in self.figures:
                values = [figures.get(key) for key in (name, *parts)]
                # No figure: a resumed run had nothing left to train, or the split has no test rows.
                none = "-" if name in figures else "no test rows"
                is_none = values[0] is None and name != "best_epoch"
                texts.append(none if is_none else form.format(*values))
            values_by_name = {
                key: [figures.get(key) for figures in self.figures] for key in (name, *parts)
            }
            columns.append(Column(name, heading, texts, values_by_name, name in SHORT))
        return Table(columns, "Errors of the steering; in brackets: always zero, the mean.")

    def show(self) -> None:
        """Print a row of Markdown for each run."""
        print(f"| {' | '.join(PRINTED)} |")
        print("|---|---|" + "---:|" * (len(PRINTED) - 2))
        for row in self.printed_table().cells:
            print(printable(f"| {' | '.join(row)} |"))
        print_written(self.written)

    def result_table(self) -> Table:
        """Return a row for each run with all figures."""
        printed = self.printed_table()
        by_name = {column.name: column for column in printed.columns}
        parts = {part for _, _, names in PRINTED.values() for part in names}
        columns = [
            by_name.get(column.name, replace(column, short=False))
            for column in Table.of_figures(self.figures).columns
            if column.name not in parts
        ]
        return Table(columns, printed.caption)


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
        from zoo.drives.metrics import metrics_page

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
    runs, figures = [Run(Path(one)) for one in folders], []
    for run in runs:
        try:
            figures.append(run_figures(run))
        except (KeyError, TypeError, AttributeError) as error:  # another program wrote the run
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise InputError(
                f"{run.folder}: its figures or config are damaged ({reason})"
            ) from None
    return FinishedRuns(runs, figures)


def run_figures(run: Run) -> dict[str, Cell]:
    """Return a run's figures by name, those of its drives with the track's name in front."""
    folder, metrics = run.folder, run.metrics
    if not metrics:
        raise InputError(f"{folder}: has no metrics.json; name a finished run")
    if metrics.get("open_loop") is None and metrics.get("tracks"):
        raise InputError(
            f"{folder}: is an evaluation, not a run; rank evaluations: drivezoo leaderboard "
            f"{shlex.quote(str(folder.parent))}"
        )
    name = run.choices["experiment"] or metrics["model"]
    found: dict[str, Cell] = {
        "run": str(folder),
        "experiment": f"{name}, quick" if run.config.get("quick") else name,
        "seed": metrics.get("seed"),
        "split": str(run.config["data"]["split"]),
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
    for track, one in run.tracks.items():
        for figure in DRIVING:
            value, deviation = one.get(figure) or (None, None)
            found |= {f"{track}_{figure}": value, f"{track}_{figure}_std": deviation}
    return found


if __name__ == "__main__":
    results.run()
