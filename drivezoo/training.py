"""The result of `drivezoo.train`."""

from dataclasses import dataclass
from pathlib import Path

from zoo.checkpoints.checkpoint_path import checkpoint_of
from zoo.evaluate.track_scores import how_well
from zoo.results import read_finished
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.table import Cell, Table
from zoo.runs.table_files import Result


@dataclass(frozen=True, repr=False)
class Training(Result):
    """A finished training.

    Attributes:
        folder: run's folder.
        metrics: contents of `metrics.json`.
    """

    folder: Path
    metrics: dict

    @classmethod
    def read(cls, folder: str | Path) -> "Training":
        """Return the training of a run's folder.

        Raises:
            InputError: the folder has no figures of a finished run.
        """
        return cls(Path(folder), read_metrics_file(Path(folder)))

    def __fspath__(self) -> str:
        """Return the folder, so that commands take the training as a path."""
        return str(self.folder)

    @property
    def checkpoint(self) -> Path | None:
        """Return the best checkpoint, or the last; None if the run kept none."""
        return checkpoint_of(self.folder)

    @property
    def figures(self) -> dict[str, Cell]:
        """Return the only row of the table: model, seed, errors and driving figures by name."""
        return self.table()[0]

    def __repr__(self) -> str:
        figures, drive = self.figures, self.metrics.get("drive") or {}
        lines = [
            f"  {track}: {how_well(one)}" for track, one in (drive.get("tracks") or {}).items()
        ]
        if (mse := figures.get("test_mse")) is not None:
            lines.insert(0, f"  test MSE {mse:.4f}, always zero {figures['test_mse_zero']:.4f}")
        return "\n".join([f"Training of {figures['experiment']} in {self.folder}", *lines])

    def result_table(self) -> Table:
        """Return one row, as `drivezoo results` prints it."""
        return read_finished([self.folder]).result_table()
