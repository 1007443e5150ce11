"""A cache of views on disk: each image is decoded once for each view.

There is one `.npy` file per recording, camera and view, named by the fingerprint of all three;
readers map it into memory. A file gets its name only when it is complete. `datamodules.features`
uses the same files.
"""

import errno
import hashlib
import json
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from filelock import FileLock, Timeout

from datamodules.image import read_image
from datamodules.view import View
from zoo.base.cores import usable_cores
from zoo.base.errors import InputError
from zoo.base.whole_file import whole_path, write_whole
from zoo.base.written_files import mark_folder, note_files

# Raise it when the output of `decode_image` or `View` changes: old files are then not read again.
VERSION = 2
CACHE = "cache"  # kind of folder
_seeking = threading.Lock()  # where a file has one position for all threads
CHUNK = 32  # images that a thread decodes, and writes, at a time
SYNC_EVERY_S = 0.02  # time between two syncs of a file that is being written

Progress = Callable[[int, int], None]
# A function that stores rows of an array from a start position; several threads may call it.
Keep = Callable[[int, np.ndarray], None]


@dataclass(frozen=True)
class ViewFile:
    """Views of N images, uint8 [N, H, W, C], and the faults of bad images by position."""

    views: np.ndarray
    faults: dict[int, str]


def load_views(
    paths: list[str],
    view: View,
    folder: Path | None,
    progress: Progress | None = None,
    on_wait: Callable[[], None] | None = None,
) -> ViewFile:
    """Return the views of images, from the cache, or decoded now and cached.

    Two processes that want the same file do not build it twice: the second waits for the first.
    Without a folder the views are kept in memory.

    Args:
        paths: image files.
        view: what a network sees.
        folder: cache's folder; None keeps the views in memory.
        progress: function called with (done, total) as images are decoded.
        on_wait: function called once if another process writes this file.

    Raises:
        InputError: the disk is full or cannot be written to.
    """
    if folder is None:
        views = np.empty((len(paths), *view.shape), np.uint8)

        def keep(start: int, chunk: np.ndarray) -> None:
            views[start : start + len(chunk)] = chunk

        return ViewFile(views, decode_all(paths, view, keep, progress))

    return load_file(
        folder / f"{cache_key(paths, view)}.npy",
        (len(paths), *view.shape),
        np.uint8,
        lambda keep: decode_all(paths, view, keep, progress),
        on_wait,
        "view cache",
    )


def load_file(
    target: Path,
    shape: tuple[int, ...],
    dtype: type,
    fill: Callable[[Keep], dict[int, str]],
    on_wait: Callable[[], None] | None,
    what: str,
) -> ViewFile:
    """Return a mapped array; write it with `fill` if the file is not complete.

    Args:
        target: file of the array.
        shape: shape of the array.
        dtype: type of its elements.
        fill: function that passes every row to its argument, and returns the faults.
        on_wait: function called once if another process writes this file.
        what: name of the contents, for errors.

    Raises:
        InputError: the disk is full or cannot be written to.
    """
    if not is_stored(target):
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            mark_folder(target.parent, CACHE)
            with _lock(target, on_wait):
                if not is_stored(target):
                    _build(target, shape, np.dtype(dtype), fill)
        except OSError as error:
            size = int(np.prod(shape)) * np.dtype(dtype).itemsize
            raise _cache_error(error, target.parent, size, what) from error
    views = np.load(target, mmap_mode="r")
    notes = json.loads(_faults_path(target).read_text(encoding="utf-8"))
    faults = {int(position): fault for position, fault in notes.items()}
    return ViewFile(views, faults)


def is_stored(target: Path) -> bool:
    """Return whether a file of the cache exists and is complete."""
    return target.exists() and _faults_path(target).exists()


def cache_key(paths: list[str], view: View) -> str:
    """Return the fingerprint of files (name, size, time of change) and view."""
    digest = hashlib.sha256(json.dumps([VERSION, view.to_dict()]).encode())
    for path in paths:
        try:
            status = os.stat(path)  # noqa: PTH116 - Path.stat costs three times as much
            name = os.path.basename(path)  # noqa: PTH119 - a moved folder keeps its views
            digest.update(f"{name}|{status.st_size}|{status.st_mtime_ns}\n".encode())
        except OSError:
            digest.update(f"{path}|missing\n".encode())
    return digest.hexdigest()[:24]


def decode_all(
    paths: list[str],
    view: View,
    keep: Keep,
    progress: Progress | None = None,
) -> dict[int, str]:
    """Decode images on all cores; return the faults by position, whose views are zeros.

    Args:
        paths: image files.
        view: what a network sees.
        keep: function that several threads call with a position and views uint8 [n, H, W, C],
            which are overwritten afterwards.
        progress: function called with (done, total).
    """
    own = threading.local()  # a chunk per thread: new memory would be cleared each time

    def decode(start: int) -> tuple[int, dict[int, str]]:
        some = paths[start : start + CHUNK]
        if not hasattr(own, "chunk"):
            own.chunk = np.empty((CHUNK, *view.shape), np.uint8)
        chunk, faults = own.chunk[: len(some)], {}
        for offset, path in enumerate(some):
            try:
                view(read_image(path), out=chunk[offset])
                continue
            except OSError as error:
                faults[start + offset] = f"{path}: {error.strerror}"
            except ValueError as error:
                faults[start + offset] = f"{path}: {error}"
            chunk[offset] = 0
        keep(start, chunk)
        return start + len(some), faults

    all_faults: dict[int, str] = {}
    threads = usable_cores()
    # OpenCV releases Python's lock while it decodes, so threads are enough. Its own threads are
    # off: they would share the work on each image.
    pool, its_own = ThreadPoolExecutor(threads), cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        starts = iter(range(0, len(paths), CHUNK))
        # Submit a few chunks ahead, not all: an error ends the work early, and memory is bounded.
        ahead = deque(pool.submit(decode, start) for start in islice(starts, 2 * threads))
        while ahead:
            done, faults = ahead.popleft().result()
            ahead.extend(pool.submit(decode, start) for start in islice(starts, 1))
            all_faults |= faults
            if progress:
                progress(done, len(paths))
    finally:
        pool.shutdown(cancel_futures=True)
        cv2.setNumThreads(its_own)
    return all_faults


def _build(
    target: Path,
    shape: tuple[int, ...],
    dtype: np.dtype,
    fill: Callable[[Keep], dict[int, str]],
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
            first, size = file.tell(), int(np.prod(shape[1:])) * dtype.itemsize

            def keep(start: int, chunk: np.ndarray) -> None:
                _write_at(file.fileno(), chunk, first + start * size)

            with _synced_early(file.fileno()):
                faults = fill(keep)
            os.fsync(file.fileno())
        write_whole(_faults_path(target), json.dumps(faults))


def _write_at(descriptor: int, chunk: np.ndarray, offset: int) -> None:
    """Write a whole chunk: on a nearly full disk the system may write only a part at first."""
    left = chunk.data.cast("B")
    while left:
        written = _write_part(descriptor, left, offset)
        left, offset = left[written:], offset + written


def _write_part(descriptor: int, data: memoryview, offset: int) -> int:
    """Write data at an offset as far as the system takes it; return the number of bytes."""
    if hasattr(os, "pwrite"):
        return os.pwrite(descriptor, data, offset)
    with _seeking:  # Windows
        os.lseek(descriptor, offset, os.SEEK_SET)
        return os.write(descriptor, data)


@contextmanager
def _synced_early(descriptor: int) -> Iterator[None]:
    """Sync a file again and again while it is written; the last sync then has little to wait for.

    The disk writes while the images are decoded.
    """
    written = threading.Event()

    def sync() -> None:
        while not written.wait(SYNC_EVERY_S):
            os.fsync(descriptor)

    pool = ThreadPoolExecutor(1)
    try:
        syncing = pool.submit(sync)
        yield
    finally:
        written.set()
        pool.shutdown()
    syncing.result()  # raises what a sync raised: the system reports a failed write only once


@contextmanager
def _lock(target: Path, on_wait: Callable[[], None] | None) -> Iterator[None]:
    """Hold the lock of a file; the system releases it when the process dies."""
    path = target.with_suffix(".lock")
    note_files(path)
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        if on_wait:
            on_wait()
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def _faults_path(target: Path) -> Path:
    return target.with_suffix(".json")


def _cache_error(error: OSError, folder: Path, size: int, what: str) -> InputError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return InputError(
            f"{folder}: no space left for the {what} ({size / 1e6:.0f} MB a camera); "
            "free some, set data.cache=FOLDER on another disk, or null to keep it in memory"
        )
    return InputError(
        f"{folder}: cannot write the {what} ({error.strerror}); "
        "set data.cache=FOLDER to a folder that can be written, or null to keep it in memory"
    )
