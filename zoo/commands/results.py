"""`drivezoo results`: print finished runs as a Markdown table."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from zoo.base.command import command
from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import print_written, printable
from zoo.checkpoints.checkpoint_path import find_run
from zoo.runs.metrics_file import NAME as METRICS
from zoo.runs.result_table import Cell, Table
from zoo.runs.run_record import Run, load_config
from zoo.runs.table_files import Result, TableFiles

ERRORS = ("mse", "mae", "balanced_mae")
DRIVING = ("autonomy", "interventions", "cte_mean_m")
SHORT = ("experiment", "parameters", "test_mse", "test_mae")  # in TeX
COPIED = ("parameters", "samples_per_second", "seconds_per_epoch", "best_epoch", "epochs")
PRINTED = (
    *("experiment", "recording", "split", *COPIED),
    *(f"test_{error}{baseline}" for error in ERRORS for baseline in ("", "_zero", "_mean")),
)


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

    def show(self) -> None:
        """Print a row of Markdown for each run."""
        rows = [{name: figures.get(name) for name in PRINTED} for figures in self.figures]
        for line in Table.of_figures(rows).markdown(left=3).splitlines():
            print(printable(line))
        print_written(self.written)

    def result_table(self) -> Table:
        """Return a row for each run with all figures."""
        columns = Table.of_figures(self.figures).columns
        caption = "Errors of the steering, and those of always zero and of the mean."
        return Table([replace(column, short=column.name in SHORT) for column in columns], caption)


@command(outputs=True)
def results(
    *run_folder: str | Path, metrics: bool = False, tables: TableFiles
) -> FinishedRuns | None:
    """Print finished runs as a Markdown table.

    Each run has a row: recording, parameters, samples per second, test errors, and the errors of
    two baselines: steering always zero, and always the mean.

    Args:
        *run_folder: folders of finished runs.
        metrics: true: print the definitions of a drive's metrics instead (docs/metrics.md).
        tables: see `TableFiles`.

    Raises:
        InputError: a folder has no figures of a finished run.
    """
    if metrics:
        from zoo.driving.metrics import metrics_page

        print(metrics_page(), end="")
        return None
    if not run_folder:
        raise UsageError(f"name the folders of finished runs; usage: {results.usage}")
    tables.check_files(inputs=run_folder)
    runs = read_finished(run_folder)
    runs.written.extend(tables.write_files(runs))
    return runs


def read_finished(folders: Sequence[str | Path]) -> FinishedRuns:
    """Return the figures of finished runs.

    Raises:
        InputError: a folder has no figures of a finished run, or they are damaged.
    """
    runs, figures = [Run(find_run(folder, METRICS)) for folder in folders], []
    for run in runs:
        try:
            figures.append(run_figures(run))
        except (KeyError, TypeError, AttributeError) as error:  # another program wrote the run
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise InputError(f"{run.folder}: figures or config are damaged ({reason})") from None
    return FinishedRuns(runs, figures)


def run_figures(run: Run) -> dict[str, Cell]:
    """Return a run's figures by name, those of its drives with the track's name in front."""
    folder, metrics = run.folder, run.metrics
    if not metrics:
        raise InputError(f"{folder}: has no {METRICS}; name a finished run")
    if metrics.get("open_loop") is None and metrics.get("tracks"):
        raise InputError(f"{folder}: is an evaluation; rank those with drivezoo leaderboard FOLDER")
    name = run.choices["experiment"] or metrics["model"]
    if run.config.get("quick"):
        from zoo.training.run_config import with_quick  # slow import: torch

        name += ", quick" * with_quick(load_config(folder)).quick
    row: dict[str, Cell] = {
        "run": str(folder),
        "experiment": name,
        "seed": metrics.get("seed"),
        "recording": run.trained_on.name,
        "split": str(run.config["data"]["split"]),
        **{name: metrics[name] for name in COPIED},
        "val_mse": metrics["open_loop"].get("val", {}).get("mse"),
    }
    if "test" in metrics["open_loop"]:
        for figure in ERRORS:
            row[f"test_{figure}"] = metrics["open_loop"]["test"][figure]
            zero, mean = (baseline[figure] for baseline in metrics["baselines"]["test"].values())
            row |= {f"test_{figure}_zero": zero, f"test_{figure}_mean": mean}
    for track, scores in run.tracks.items():
        for figure in DRIVING:
            value, deviation = scores.get(figure) or (None, None)
            row |= {f"{track}_{figure}": value, f"{track}_{figure}_std": deviation}
    return row


if __name__ == "__main__":
    results.run()
