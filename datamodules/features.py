"""Features of images from a network's frozen layers, computed once and cached as views are.

Here a front is any pure function of an image; this module knows nothing of networks.
"""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from rich.console import Console
from torch.utils.data import Dataset

from datamodules.balance import BatchKey
from datamodules.batches import Batch, TrainingBatches, make_batch
from datamodules.driving_log import CAMERAS
from datamodules.recording import Recording
from datamodules.row_views import RowViews, ShowDone, image_progress
from datamodules.view import View
from datamodules.view_store import Keep, cache_key, is_stored, load_file

# Raise it when the cached features of an image change: old files are then not read again.
VERSION = 1
CHUNK = 32  # images read at a time
MIRRORED = len(CAMERAS)  # added to a camera's number for its mirrored images


@dataclass(frozen=True)
class Front:
    """A pure function of images.

    Attributes:
        compute: function from images, uint8 [n, H, W, C], to features, float16 [n, h, w, c].
        shape: `(h, w, c)`.
        fingerprint: hash of all that the features depend on, except the image.
    """

    compute: Callable[[np.ndarray], np.ndarray]
    shape: tuple[int, int, int]
    fingerprint: str

    @property
    def image_bytes(self) -> int:
        """Return the bytes of one image's features."""
        return int(np.prod(self.shape)) * np.dtype(np.float16).itemsize


@dataclass(frozen=True)
class FeatureFile:
    """A file of the cache: features of one recording's images of one camera, or mirrored.

    Attributes:
        rows: recording's rows, int64 [n].
        column: column of `RowViews.file`: the camera, plus `MIRRORED` for mirrored images.
        name: description for the user.
        target: path of the file; None in memory.
    """

    rows: np.ndarray
    column: int
    name: str
    target: Path | None


@dataclass(frozen=True)
class FeaturePlan:
    """The feature files that a training needs.

    Attributes:
        files: all files, cached or not.
        front: function that computes them.
        folder: folder of the cache; None for memory.
    """

    files: list[FeatureFile]
    front: Front
    folder: Path | None

    @property
    def images(self) -> int:
        """Return the number of images, with those in the cache."""
        return sum(len(file.rows) for file in self.files)

    @property
    def missing(self) -> int:
        """Return the number of images that are not in the cache."""
        return sum(len(file.rows) for file in self.files if not is_stored(file.target))

    @property
    def missing_bytes(self) -> int:
        """Return the bytes that the missing features will take."""
        return self.missing * self.front.image_bytes

    def free_bytes(self) -> int:
        """Return the free bytes of the cache's disk, or of memory."""
        if self.folder is None:
            return psutil.virtual_memory().available
        folder = self.folder.absolute()
        there = next(path for path in (folder, *folder.parents) if path.exists())
        return shutil.disk_usage(there).free


def plan_features(
    recording: Recording,
    views: RowViews,
    cameras: Sequence[str],
    view: View,
    front: Front,
    mirrored: bool,
    cache: Path | None,
) -> FeaturePlan:
    """Return the plan for all `views`; if `mirrored`, also for mirrored images of `cameras`."""
    files = []
    for number, name in enumerate(recording.names):
        for camera, camera_name in enumerate(CAMERAS):
            rows = np.flatnonzero((recording.recording == number) & (views.file[:, camera] >= 0))
            if not len(rows):
                continue
            images = cache_key(list(recording.images[rows, camera]), view) if cache else ""
            for turned in (False, True)[: 1 + (mirrored and camera_name in cameras)]:
                key = json.dumps([VERSION, images, front.fingerprint, turned])
                digest = hashlib.sha256(key.encode()).hexdigest()[:24]
                files.append(
                    FeatureFile(
                        rows,
                        camera + MIRRORED * turned,
                        f"{name}, {camera_name}{', mirrored' * turned}",
                        cache / f"{digest}.npy" if cache else None,
                    )
                )
    return FeaturePlan(files, front, cache)


def load_features(plan: FeaturePlan, views: RowViews, console: Console) -> RowViews:
    """Return float16 features by row and camera, from the cache or computed now.

    The mirrored image of camera `c` is at `c + MIRRORED`.

    Raises:
        InputError: the cache cannot be written.
    """
    with image_progress(console) as show:
        loaded = (
            (file.rows, file.column, _load(file, plan.front, views, show)) for file in plan.files
        )
        return RowViews.placed((len(views.file), 2 * len(CAMERAS)), loaded)


def _load(file: FeatureFile, front: Front, views: RowViews, show: ShowDone) -> np.ndarray:
    camera, turned = file.column % MIRRORED, file.column >= MIRRORED

    def fill(keep: Keep) -> dict[int, str]:
        for start in range(0, len(file.rows), CHUNK):
            rows = file.rows[start : start + CHUNK]
            keep(front.compute(views.take(rows, camera, np.full(len(rows), turned))))
            show(f"frozen blocks on {file.name}", start + len(rows), len(file.rows))
        return {}

    shape = (len(file.rows), *front.shape)
    return load_file(file.target, shape, np.float16, fill, "features' cache").views


@dataclass(frozen=True)
class FeatureBatches(Dataset):
    """The batches of `TrainingBatches` with features in place of images.

    `images` holds features, float16 [n, c, h, w], of the images that it would hold.
    """

    batches: TrainingBatches
    features: RowViews

    def __getitem__(self, key: BatchKey) -> Batch:
        samples, shard = self.batches.samples, key.own
        mirrored, steering, throttle, _ = self.batches.draw(key)
        taken = self.features.take(samples.row[shard], samples.camera[shard] + MIRRORED * mirrored)
        return make_batch(taken, steering, throttle, samples.speed_mph[shard])
