"""A cache of views on disk: each image is decoded once for each view.

There is one `.npy` file per recording, camera and view, named by the fingerprint of all three;
readers map it into memory. A file gets its name only when it is complete. `datamodules.features`
uses the same files.
"""

import hashlib
import json
import os
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from filelock import FileLock, Timeout

from datamodules.image import AnyImage, StoredImage, read_image, reading_threads
from datamodules.view import View
from zoo.base.errors import InputError
from zoo.base.machine import usable_cores
from zoo.base.whole_file import whole_path, write_whole

# Raise it when the output of `decode_image` or `View` changes: old files are then not read again.
VERSION = 3
CHUNK = 32  # images that a thread decodes at a time
SYNC_EVERY_S = 0.02  # time between two syncs of a file that is being written

Progress = Callable[[int, int], None]
Keep = Callable[[Any], object]  # function that stores an array's next rows


@dataclass(frozen=True)
class ViewFile:
    """Views of N images, uint8 [N, H, W, C], and the faults of bad images by position."""

    views: np.ndarray
    faults: dict[int, str]


def load_views(
    images: Sequence[AnyImage], view: View, folder: Path | None, progress: Progress | None = None
) -> ViewFile:
    """Return the views of images, from the cache, or decoded now and cached.

    Two processes that want the same file do not build it twice: the second waits for the first.
    Without a folder the views are kept in memory.

    Args:
        images: image files, or images in larger files.
        view: what a network sees.
        folder: cache's folder; None keeps the views in memory.
        progress: function called with (done, total) as images are decoded.

    Raises:
        InputError: the disk is full or cannot be written to.
    """
    loaded = load_file(
        folder and folder / f"{cache_key(images, view)}.npy",
        (len(images), *view.shape),
        np.uint8,
        lambda keep: decode_all(images, view, keep, progress),
        "view cache",
    )
    # The cache holds no paths: a moved folder keeps its views.
    return ViewFile(loaded.views, {n: f"{images[n]}: {why}" for n, why in loaded.faults.items()})


def load_file(
    target: Path | None,
    shape: tuple[int, ...],
    dtype: type,
    fill: Callable[[Keep], dict[int, str]],
    what: str,
) -> ViewFile:
    """Return a mapped array; write it with `fill` if the file is not complete.

    Args:
        target: file of the array; None keeps it in memory.
        shape: shape of the array.
        dtype: type of its elements.
        fill: function that passes chunks of rows, in order, to its argument, and returns the
            faults.
        what: name of the contents, for errors.

    Raises:
        InputError: the disk is full or cannot be written to.
    """
    if target is None:
        array: np.ndarray = np.empty(shape, dtype)
        done = 0

        def keep(chunk: np.ndarray) -> None:
            nonlocal done
            array[done : done + len(chunk)] = chunk
            done += len(chunk)

        return ViewFile(array, fill(keep))
    if not is_stored(target):
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with _lock(target):
                if not is_stored(target):
                    _build(target, shape, np.dtype(dtype), fill)
        except OSError as error:
            size_mb = np.prod(shape) * np.dtype(dtype).itemsize / 1e6
            raise InputError(
                f"{target.parent}: cannot write the {what}, {size_mb:.0f} MB a camera "
                f"({error.strerror}); set data.cache=FOLDER on another disk, or null to keep it in "
                "memory"
            ) from error
    views = np.load(target, mmap_mode="r")
    notes = json.loads(_faults_path(target).read_text(encoding="utf-8"))
    return ViewFile(views, {int(position): fault for position, fault in notes.items()})


def is_stored(target: Path | None) -> bool:
    """Return whether a file of the cache exists and is complete."""
    return target is not None and target.exists() and _faults_path(target).exists()


def cache_key(images: Sequence[AnyImage], view: View) -> str:
    """Return the fingerprint of files (name, size, time of change), places in them, and view."""
    seen = view.to_dict() | {"size": view.shape[:2], "frame": None}  # whatever they follow from
    digest = hashlib.sha256(json.dumps([VERSION, seen]).encode())
    file: str | Path | None = None
    state = b""
    for image in images:
        path = image.file if isinstance(image, StoredImage) else image
        if path != file:
            file, state = path, _file_key(path)
        digest.update(state)
        if isinstance(image, StoredImage):
            digest.update(f"{image.number}|{image.column}".encode())
    return digest.hexdigest()[:24]


def _file_key(path: str | Path) -> bytes:
    try:
        status = os.stat(path)  # noqa: PTH116 - Path.stat costs three times as much
        if not os.access(path, os.R_OK):  # once it can be read, it has views
            return f"{path}|unreadable\n".encode()
    except OSError:
        return f"{path}|missing\n".encode()
    name = os.path.basename(path)  # noqa: PTH119 - a moved folder keeps its views
    return f"{name}|{status.st_size}|{status.st_mtime_ns}\n".encode()


def decode_all(
    images: Sequence[AnyImage], view: View, keep: Keep, progress: Progress | None = None
) -> dict[int, str]:
    """Decode images on all cores; return the faults by position, whose views are zeros.

    Args:
        images: image files, or images in larger files.
        view: what a network sees.
        keep: function that takes views, uint8 [n, H, W, C], in the order of the images.
        progress: function called with (done, total).
    """

    def decode(start: int) -> tuple[np.ndarray, dict[int, str]]:
        some = images[start : start + CHUNK]
        chunk, faults = np.zeros((len(some), *view.shape), np.uint8), {}
        for offset, image in enumerate(some):
            try:
                view(read_image(image), out=chunk[offset])
            except (OSError, ValueError) as error:
                faults[start + offset] = str(getattr(error, "strerror", None) or error)
        return chunk, faults

    all_faults: dict[int, str] = {}
    done = 0
    threads = reading_threads(images, usable_cores())
    # OpenCV releases Python's lock while it decodes, so threads are enough. Its own threads are
    # off: they would share the work on each image.
    pool, its_own = ThreadPoolExecutor(threads), cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        starts = iter(range(0, len(images), CHUNK))
        # Submit a few chunks ahead, not all: an error ends the work early, and memory is bounded.
        ahead = deque(pool.submit(decode, start) for start in islice(starts, 2 * threads))
        while ahead:
            chunk, faults = ahead.popleft().result()
            ahead.extend(pool.submit(decode, start) for start in islice(starts, 1))
            keep(chunk)
            done += len(chunk)
            all_faults |= faults
            if progress:
                progress(done, len(images))
    finally:
        pool.shutdown(cancel_futures=True)
        cv2.setNumThreads(its_own)
    return all_faults


def _build(
    target: Path, shape: tuple[int, ...], dtype: np.dtype, fill: Callable[[Keep], dict[int, str]]
) -> None:
    """Write `target` in one step: it is never incomplete."""
    for left in target.parent.glob(f".{target.name}.*.part"):
        left.unlink(missing_ok=True)  # of a killed process: we hold the lock
    with whole_path(target) as part:
        # Not mapped: on a full disk a write raises an error, but a mapped page kills the process.
        with part.open("wb") as file:
            header = {"descr": dtype.str, "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(file, header)
            file.flush()
            with _synced_early(file.fileno()):
                faults = fill(file.write)
                file.flush()
        write_whole(_faults_path(target), json.dumps(faults))


@contextmanager
def _synced_early(descriptor: int) -> Iterator[None]:
    """Sync a file again and again while it is written, and at the end.

    The disk writes while images are decoded: 0.90 to 0.93 of the rate of decoding alone, instead of
    0.83 to 0.86 with one sync at the end.
    """
    written = threading.Event()

    def sync() -> None:
        while not written.wait(SYNC_EVERY_S):
            os.fsync(descriptor)

    with ThreadPoolExecutor(1) as pool:
        syncing = pool.submit(sync)
        try:
            yield
        finally:
            written.set()
    syncing.result()  # raises what a sync raised: the system reports a failed write only once
    os.fsync(descriptor)


def _lock(target: Path) -> AbstractContextManager:
    """Return the held lock of a file; the system releases it when the process dies."""
    lock = FileLock(target.with_suffix(".lock"))
    try:
        return lock.acquire(timeout=0)
    except Timeout:
        print(f"{target.parent}: another process writes {target.name}; waiting", file=sys.stderr)
        return lock.acquire()


def _faults_path(target: Path) -> Path:
    return target.with_suffix(".json")
