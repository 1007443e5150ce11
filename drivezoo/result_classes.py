"""The results of `drivezoo.train` and `drivezoo.drive`."""

from dataclasses import dataclass
from pathlib import Path

from zoo.drives.drive_log import SUMMARY_NAME, read_summary
from zoo.drives.metrics import METRICS
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


@dataclass(frozen=True, repr=False)
class ServedDrive(Result):
    """A drive on the socket.

    Attributes:
        folder: drive's folder.
        figures: contents of `drive.json`.
    """

    folder: Path
    figures: dict

    @classmethod
    def read(cls, folder: Path) -> "ServedDrive":
        """Return the drive of a folder.

        Raises:
            InputError: the folder has no readable `drive.json`.
        """
        return cls(folder, read_summary(folder / SUMMARY_NAME))

    def __repr__(self) -> str:
        driven_m, lost = (self.figures.get(key) or 0 for key in ("driven_m", "interventions"))
        return f"ServedDrive in {self.folder}: {driven_m:.0f} m, {lost:g} interventions"

    def result_table(self) -> Table:
        """Return one row with all figures."""
        return Table.of_figures([{key: one for key, one in self.figures.items() if key in METRICS}])
