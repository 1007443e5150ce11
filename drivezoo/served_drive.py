"""The result of `drivezoo.drive`."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from zoo.drives.drive_log import SUMMARY_NAME, read_summary
from zoo.drives.metrics import METRICS
from zoo.runs.table import Table
from zoo.runs.table_files import Result


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


@contextmanager
def kept_signals() -> Iterator[None]:
    """Restore the handlers of Ctrl-C and SIGTERM at the end."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
