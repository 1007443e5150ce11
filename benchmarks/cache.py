"""Measure how fast all cores decode into the cache: `python benchmarks/cache.py [parts [FOLDER]]`.

`parts` prints the microseconds of each part of an image's work on one core, for the images in a
folder.
"""

import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from benchmarks.material import OUT, linked_recording
from benchmarks.timing import Row, compared, medians, run_part, take_turns
from datamodules.image import MOST_IMAGE_BYTES, decode_image
from datamodules.view import View
from datamodules.view_store import CHUNK, load_views
from zoo.base.cores import usable_cores
from zoo.base.regular_file import read_regular

VIEW = View((40, 20), "rgb", (66, 200))
ROWS = 1_500


def measure(short: bool) -> list[Row]:
    """Measure images per second, relative to one thread and to one process for each core.

    The references only read, decode and resize. The one with processes shows the speed that the
    machine has at that moment.
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
    what = "building the view cache, written and synced"
    one, many = "one thread that decodes", f"{cores} processes that decode"
    return [
        compared(found, what, f"{one} and resizes", ("ours/s", "one thread/s"), 0.8 * cores),
        compared(found, what, f"{many} and resize", ("ours/s", "processes/s"), 0.95),
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


def parts_of_image(paths: list[str]) -> dict[str, float]:
    """Return the microseconds that each part takes for an image: medians, but for the sync."""
    cv2.setNumThreads(1)
    chunk = np.zeros((CHUNK, *VIEW.shape), np.uint8)
    times: dict[str, list[float]] = {}

    def timed(part: str, work: Callable, *arguments: object) -> None:
        began = time.perf_counter()
        work(*arguments)
        times.setdefault(part, []).append(1e6 * (time.perf_counter() - began))

    OUT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=OUT) as file:
        for path in paths:
            data = read_regular(path, MOST_IMAGE_BYTES)
            image, pixels = decode_image(data), np.frombuffer(data, np.uint8)
            timed("read", read_regular, path, MOST_IMAGE_BYTES)
            timed("check and decode", decode_image, data)
            timed("of that, decode", cv2.imdecode, pixels, cv2.IMREAD_COLOR_RGB)
            timed("crop and resize", VIEW, image, chunk[0])
        for _ in range(0, len(paths), CHUNK):
            timed("write", os.write, file.fileno(), chunk.data)
        sync = 1e6 * seconds_of(lambda: os.fsync(file.fileno())) / len(paths)
    found = medians(times)
    return found | {"write": found["write"] / CHUNK, "sync, if it is one at the end": sync}


def print_parts(folder: Path) -> None:
    """Print the parts of an image's work for up to `ROWS` images."""
    for part, microseconds in parts_of_image(sorted(map(str, folder.glob("*.jpg")))[:ROWS]).items():
        print(f"{part}: {microseconds:.1f}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["parts"]:
        folder = sys.argv[2] if sys.argv[2:] else linked_recording(ROWS, ("center",)) / "IMG"
        print_parts(Path(folder))
    else:
        run_part(measure)
