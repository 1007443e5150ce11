"""`python benchmarks/cache.py`: decoding a recording into the cache of views, on all cores."""

import shutil
import time
from pathlib import Path

from material import OUT, linked_recording
from timing import Row, median_ratio, medians, run_part, take_turns

from datamodules.cores import usable_cores
from datamodules.image import decode_image
from datamodules.view import View
from datamodules.view_store import load_views


def measure(short: bool) -> list[Row]:
    """Pictures a second, as a multiple of one thread's that reads, decodes and resizes them."""
    rows, rounds = (100, 1) if short else (1_500, 7)
    folder = linked_recording(rows, ("center",))
    paths = sorted(map(str, (folder / "IMG").iterdir()))
    view, cache = View((40, 20), "rgb", (66, 200)), OUT / "built"

    def ours() -> float:
        shutil.rmtree(cache, ignore_errors=True)
        began = time.perf_counter()
        load_views(paths, view, cache)
        return rows / (time.perf_counter() - began)

    def one_thread() -> float:
        began = time.perf_counter()
        for path in paths:
            view(decode_image(Path(path).read_bytes()))
        return rows / (time.perf_counter() - began)

    found = take_turns({"ours/s": ours, "one thread/s": one_thread}, rounds)
    shutil.rmtree(cache, ignore_errors=True)
    aim, ratio = 0.8 * usable_cores(), median_ratio(*found.values())
    what = "building the view cache, written and synced"
    return [Row(what, "one thread that decodes and resizes", ratio, aim, True, medians(found))]


if __name__ == "__main__":
    run_part(measure)
