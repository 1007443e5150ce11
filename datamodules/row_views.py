"""The views of a recording's rows and cameras, wherever their files are."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from datamodules.driving_log import CAMERAS
from datamodules.recording import Recording
from datamodules.view import View
from datamodules.view_store import load_views


@dataclass(frozen=True)
class RowViews:
    """Pictures by row and camera.

    There is a file per recording and camera, so that one more recording, or one more camera,
    decodes nothing again.

    Attributes:
        files: uint8 [n, H, W, C], in memory or mapped.
        file: int64 [N, 3], which of the files holds a row's picture of a camera.
        position: int64 [N, 3], where in that file.
    """

    files: list[np.ndarray]
    file: np.ndarray
    position: np.ndarray

    def keep(self, mask: np.ndarray) -> "RowViews":
        """The views of the rows in `mask`, as `Recording.keep`."""
        return RowViews(self.files, self.file[mask], self.position[mask])

    def take(self, rows: np.ndarray, cameras: np.ndarray | int) -> np.ndarray:
        """Pictures uint8 [n, H, W, C] of rows (int64 [n]) and cameras (int64 [n], or one)."""
        files, positions = self.file[rows, cameras], self.position[rows, cameras]
        out = np.empty((len(rows), *self.files[0].shape[1:]), np.uint8)
        for number in np.unique(files):
            mask = files == number
            out[mask] = self.files[number][positions[mask]]
        return out


def load_row_views(
    recording: Recording, cameras: list[str], view: View, cache: Path | None, console: Console
) -> tuple[RowViews, dict[int, str]]:
    """The views of all rows, decoded now or found in the cache, and what was wrong, by row.

    Raises:
        InputError: the cache cannot be written.
    """
    file = np.full((len(recording), len(CAMERAS)), -1)
    position = file.copy()
    files: list[np.ndarray] = []
    faults: dict[int, str] = {}
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None, visible=False)

        def show(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total, visible=True)

        for number, name in enumerate(recording.names):
            for camera in sorted(CAMERAS.index(one) for one in set(cameras)):
                rows = np.flatnonzero(recording.recording == number)
                rows = rows[[path is not None for path in recording.images[rows, camera]]]
                if not len(rows):
                    continue
                progress.update(task, description=f"decoding {name}, {CAMERAS[camera]}")
                loaded = load_views(
                    list(recording.images[rows, camera]),
                    view,
                    cache,
                    show,
                    lambda: console.print("another process decodes these images; waiting for it"),
                )
                file[rows, camera] = len(files)
                position[rows, camera] = np.arange(len(rows))
                files.append(loaded.views)
                faults |= {int(rows[at]): fault for at, fault in loaded.faults.items()}
    return RowViews(files, file, position), faults
