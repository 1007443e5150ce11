"""Measure how fast all cores decode into the cache: `make bench ONLY=cache`."""

import multiprocessing
import shutil
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2

from benchmarks.material import OUT, linked_recording
from benchmarks.measuring import Row, compared, seconds_of, take_turns
from datamodules.image import decode_image
from datamodules.view import View
from datamodules.view_store import load_views
from zoo.base.machine import usable_cores

VIEW = View((40, 20), "rgb", (66, 200))
ROWS = 1_500


def measure(short: bool) -> list[Row]:
    """Measure images per second, relative to one process for each core.

    These only read, decode and resize.
    """
    rows, rounds = (100, 1) if short else (ROWS, 5)
    folder = linked_recording(rows, ("center",))
    paths = sorted(map(str, (folder / "IMG").iterdir()))
    cache, cores = OUT / "built", usable_cores()
    shares = [paths[number::cores] for number in range(cores)]

    def ours() -> float:
        shutil.rmtree(cache, ignore_errors=True)
        return rows / seconds_of(lambda: load_views(paths, VIEW, cache))

    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(cores, spawn, cv2.setNumThreads, (1,)) as pool:
        # Starts the processes and their imports.
        list(pool.map(decode, [share[:5] for share in shares]))
        speeds = take_turns(
            {
                "ours/s": ours,
                "processes/s": lambda: rows / seconds_of(lambda: list(pool.map(decode, shares))),
            },
            rounds,
        )
    shutil.rmtree(cache, ignore_errors=True)
    what = "building the view cache, written and synced"
    processes = f"{cores} processes that decode and resize"
    return [compared(speeds, what, processes, ("ours/s", "processes/s"), 0.9)]


def decode(paths: list[str]) -> None:
    """Make the views of images and discard them."""
    for path in paths:
        VIEW(decode_image(Path(path).read_bytes()))


def decode_in_one_thread(paths: list[str]) -> None:
    """Decode with OpenCV's own threads off."""
    its_own = cv2.getNumThreads()
    cv2.setNumThreads(1)
    decode(paths)
    cv2.setNumThreads(its_own)
