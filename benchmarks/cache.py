"""Measure how fast all cores decode a recording into the cache: `python benchmarks/cache.py`."""

import multiprocessing
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
from material import OUT, linked_recording
from timing import Row, median_ratio, medians, run_part, take_turns

from datamodules.cores import usable_cores
from datamodules.image import decode_image
from datamodules.view import View
from datamodules.view_store import load_views

VIEW = View((40, 20), "rgb", (66, 200))


def measure(short: bool) -> list[Row]:
    """Measure images per second, relative to one thread and to one process for each core.

    The references only read, decode and resize. The one with processes shows the speed that the
    machine has at that moment.
    """
    rows, rounds = (100, 1) if short else (1_500, 5)
    folder = linked_recording(rows, ("center",))
    paths = sorted(map(str, (folder / "IMG").iterdir()))
    cache, cores = OUT / "built", usable_cores()
    shares = [paths[number::cores] for number in range(cores)]

    def ours() -> float:
        shutil.rmtree(cache, ignore_errors=True)
        return rows / seconds_of(lambda: load_views(paths, VIEW, cache))

    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(cores, spawn, cv2.setNumThreads, (1,)) as pool:
        list(
            pool.map(decode, [share[:5] for share in shares])
        )  # starts the processes and their imports
        found = take_turns(
            {
                "ours/s": ours,
                "one thread/s": lambda: rows / seconds_of(lambda: decode_in_one_thread(paths)),
                "processes/s": lambda: rows / seconds_of(lambda: list(pool.map(decode, shares))),
            },
            rounds,
        )
    shutil.rmtree(cache, ignore_errors=True)
    rates, one, many = found.values()
    what = "building the view cache, written and synced"
    return [
        Row(
            what,
            "one thread that decodes and resizes",
            median_ratio(rates, one),
            0.8 * cores,
            True,
            medians(found),
        ),
        Row(
            what,
            f"{cores} processes that decode and resize",
            median_ratio(rates, many),
            0.95,
            figures=medians({"ours/s": rates, "processes/s": many}),
        ),
    ]


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


def seconds_of(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


if __name__ == "__main__":
    run_part(measure)
