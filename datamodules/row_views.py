"""The views of a recording's rows and cameras, in memory or in mapped files."""

import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from datamodules.driving_log import CAMERAS
from datamodules.image import ImageStore, StoredImage, read_image, shard_of
from datamodules.recording import Recording, file_name
from datamodules.samples import camera_numbers
from datamodules.view import View
from datamodules.view_store import load_views
from zoo.base.errors import InputError

# Views up to this total size are joined in memory, where one call takes a batch. Larger ones stay
# mapped, so that memory does not grow with the rows.
RESIDENT_BYTES = 16_000_000
SMALL_BYTES = 1_000  # below it, a call for each image costs more than copying the image

ShowDone = Callable[[str, int, int], None]
Part = tuple[np.ndarray, int, np.ndarray]  # rows of an array of images, their camera, the array


@dataclass(frozen=True)
class ShardViews:
    """The views of a shard's images, decoded at each reading.

    Attributes:
        file: shard's place, as in `StoredImage`.
        reader: store of the shard.
        view: what a network sees.
    """

    file: str
    reader: ImageStore
    view: View
    dtype = np.dtype(np.uint8)
    nbytes = sys.maxsize  # never copied whole to memory or to a device

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the number of images, and a view's height, width and channels."""
        return (self.reader.images[file_name(self.file)], *self.view.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, number: Any) -> np.ndarray:
        """Return the view of an image, uint8 [H, W, C]; take no slices."""
        image = StoredImage(self.file, number, self.reader)
        try:
            return self.view(read_image(image))
        except (OSError, ValueError) as error:
            fault = getattr(error, "strerror", None) or error
            raise InputError(f"{image}: {fault}; {self.reader.remedy}") from None


@dataclass(frozen=True)
class RowViews:
    """Images by row and camera.

    There is a file per recording and camera: adding a recording or a camera decodes nothing again.
    Of shards, each is a file.

    Attributes:
        files: images uint8, or features float16, [n, H, W, C] each, in memory, mapped or in shards.
        file: index in `files` for each row and camera, int64 [N, 3]; -1 without an image.
        position: index in that file, int64 [N, 3].
    """

    files: list[np.ndarray | ShardViews]
    file: np.ndarray
    position: np.ndarray

    @classmethod
    def placed(cls, shape: tuple[int, int], parts: Iterable[Part]) -> "RowViews":
        """Return the views of `shape`, rows and cameras, from each array's rows and camera."""
        views = cls([], np.full(shape, -1), np.full(shape, -1))
        for rows, camera, array in parts:
            views.file[rows, camera] = len(views.files)
            views.position[rows, camera] = np.arange(len(rows))
            views.files.append(np.asarray(array))  # a memmap is slow to index
        return views

    @property
    def shards(self) -> list[ShardViews]:
        """Return the shards; none if the views are decoded already."""
        return [file for file in self.files if isinstance(file, ShardViews)]

    def fetch_ahead(self, files: np.ndarray) -> None:
        """Start to fetch shards, by index in `files`, that the next batches need."""
        for store in {shard.reader for shard in self.shards}:
            wanted = [self.shards[file] for file in files]
            store.fetch_ahead([file_name(image.file) for image in wanted if image.reader is store])

    def keep(self, mask: np.ndarray) -> "RowViews":
        """Return the views of the rows in `mask`, as `Recording.keep`."""
        return RowViews(self.files, self.file[mask], self.position[mask])

    def take(
        self, rows: np.ndarray, cameras: np.ndarray | int, mirrored: np.ndarray | None = None
    ) -> np.ndarray:
        """Return copies of images, uint8 [n, H, W, C], or of windows, [n, sequence, H, W, C].

        Args:
            rows: row numbers, int64 [n] or [n, sequence].
            cameras: camera of each row, int64 [n] or [n, 1], or one for all.
            mirrored: whether to flip an image, or a window's images, left to right, bool [n].
        """
        positions = self.position[rows, cameras]
        turned = np.zeros(len(rows), bool) if mirrored is None else mirrored
        only = self.files[0]
        if len(self.files) == 1 and isinstance(only, np.ndarray) and only[0].nbytes < SMALL_BYTES:
            out = only[positions]
            out[turned] = out[turned][..., ::-1, :]
            return out
        shape, sequence = self.files[0].shape[1:], math.prod(rows.shape[1:])
        out = np.empty((len(turned) * sequence, *shape), self.files[0].dtype)
        columns = (self.file[rows, cameras], positions, np.repeat(turned, sequence))
        # One by one: numpy would copy the whole batch four times, and mirrors slowly.
        for at, (file, position, turn) in enumerate(
            zip(*(column.ravel().tolist() for column in columns), strict=True)
        ):
            image = self.files[file][position]
            if turn:
                cv2.flip(image, 1, out[at])
            else:
                out[at] = image
        return out.reshape(*rows.shape, *shape)

    def resident(self) -> "RowViews":
        """Return the same views with all files in one array in memory."""
        starts = np.cumsum([0, *map(len, self.files)])[:-1]
        position = np.where(self.file >= 0, self.position + starts[self.file], -1)
        return RowViews(
            [np.concatenate(list(map(np.asarray, self.files)))], np.minimum(self.file, 0), position
        )


@contextmanager
def image_progress(console: Console) -> Iterator[ShowDone]:
    """Yield a function that shows a bar with a description, and the done of all images."""
    text = TextColumn("{task.description}", markup=False)  # a folder's name is no markup
    columns = (text, BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    shown = console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=not shown) as progress:
        task = progress.add_task("", total=None, visible=False)

        def show(what: str, done: int, total: int) -> None:
            progress.update(task, description=what, completed=done, total=total, visible=True)

        yield show


def load_row_views(
    recording: Recording, cameras: list[str], view: View, cache: Path | None, console: Console
) -> tuple[RowViews, dict[int, str]]:
    """Return the views of all rows, from the cache or decoded now, and faults by row.

    Raises:
        InputError: the cache cannot be written, or shards are joined with another format.
    """
    in_shards = [shard_of(image) for image in recording.images.flat if image is not None]
    if any(in_shards):
        if not all(in_shards):
            raise InputError(
                "data.root: shards cannot be trained on together with another format; convert the "
                "others: drivezoo convert FOLDER to=shards out=NEW"
            )
        return _shard_views(recording, camera_numbers(cameras), view), {}
    parts: list[Part] = []
    faults: dict[int, str] = {}
    with image_progress(console) as show:
        for number, name in enumerate(recording.names):
            for camera in camera_numbers(cameras):
                rows = np.flatnonzero(recording.recording == number)
                rows = rows[[path is not None for path in recording.images[rows, camera]]]
                if not len(rows):
                    continue
                loaded = load_views(
                    list(recording.images[rows, camera]),
                    view,
                    cache,
                    partial(show, f"decoding {name}, {CAMERAS[camera]}"),
                )
                parts.append((rows, camera, loaded.views))
                faults |= {int(rows[at]): fault for at, fault in loaded.faults.items()}
    views = RowViews.placed((len(recording), len(CAMERAS)), parts)
    small = parts and sum(file.nbytes for file in views.files) <= RESIDENT_BYTES
    return views.resident() if small else views, faults


def _shard_views(recording: Recording, cameras: list[int], view: View) -> RowViews:
    """Return views that are decoded when they are taken."""
    file = np.full((len(recording), len(CAMERAS)), -1)
    position = file.copy()
    numbers: dict[tuple[str, ImageStore], int] = {}
    for camera in cameras:
        for row, image in enumerate(recording.images[:, camera]):
            if shard := shard_of(image):
                file[row, camera] = numbers.setdefault(shard, len(numbers))
                position[row, camera] = image.number
    return RowViews([ShardViews(*shard, view) for shard in numbers], file, position)
