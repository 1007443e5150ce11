"""The result of `drivezoo.train`."""

from pathlib import Path

from zoo.evaluate.track_scores import how_well
from zoo.results import read_finished
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.run import Run
from zoo.runs.table import Cell, Table
from zoo.runs.table_files import Result


class Training(Run, Result):
    """A finished training: a run with the table of its figures."""

    @classmethod
    def read(cls, folder: str | Path) -> "Training":
        """Return the training of a run's folder.

        Raises:
            InputError: the folder has no figures of a finished run.
        """
        read_metrics_file(Path(folder))
        return cls(Path(folder))

    def __fspath__(self) -> str:
        """Return the folder, so that commands take the training as a path."""
        return str(self.folder)

    @property
    def checkpoint(self) -> Path | None:
        """Return the best checkpoint, or the last; None if the run kept none."""
        return self.checkpoint_path

    @property
    def figures(self) -> dict[str, Cell]:
        """Return the only row of the table: model, seed, errors and driving figures by name."""
        return self.table()[0]

    def __repr__(self) -> str:
        figures = self.figures
        lines = [f"  {track}: {how_well(one)}" for track, one in self.tracks.items()]
        if (mse := figures.get("test_mse")) is not None:
            lines.insert(0, f"  test MSE {mse:.4f}, always zero {figures['test_mse_zero']:.4f}")
        return "\n".join([f"Training of {figures['experiment']} in {self.folder}", *lines])

    def result_table(self) -> Table:
        """Return one row, as `drivezoo results` prints it."""
        return read_finished([self.folder]).result_table()
