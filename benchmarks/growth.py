"""Measure time and memory by stage and rows: `python benchmarks/growth.py [ROWS...] [docs]`.

Time is processor time of all threads, so that other processes do not change it. 300,000 rows take
ten minutes. Images are hard links to the same few files. `docs` also writes docs/growth.md.
"""

import csv
import ctypes
import gc
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

from rich.console import Console

from benchmarks.marked_page import markdown_table, write_between
from benchmarks.material import OUT, config_for, linked_recording, ready_to_fit
from benchmarks.measuring import print_table
from benchmarks.timing import Row, contestants, median_ratio, medians, run_part
from zoo.base.cores import usable_cores

MEMORY = "memory without the page cache, MB"
IN_USE = "of that, without freed memory, MB"
EPOCH = "an epoch"
MEGABYTES = (MEMORY, IN_USE)
LOG_ROWS = 1_000_000
DOCS = Path("docs/growth.md")


def measure(short: bool) -> list[Row]:
    """Measure the growth of each stage's time and of memory, and reading a long log."""
    if short:
        return [*growth_rows(200, 400, 1), *log_rows(2_000)]
    # From 4,000 rows on, the number of compared held-out rows is constant (`datamodules.leak`).
    return [*growth_rows(4_000, 20_000, 2), *log_rows(LOG_ROWS)]


def growth_rows(few: int, many: int, rounds: int) -> list[Row]:
    """Compare each stage on many rows with the same on few rows; times count for each row."""
    found = stages_of([few, many] * rounds)
    rows = []
    for stage in found[0]:
        less, more = ([turn[stage] for turn in found[which::2]] for which in (0, 1))
        unit = "MB" if stage in MEGABYTES else "s"
        figures = medians({f"{few} rows {unit}": less, f"{many} rows {unit}": more})
        if stage in MEGABYTES:
            what, reference, aim = stage.removesuffix(", MB"), f"on {few:,}", 1.1
        else:
            what, reference = stage, f"{many // few} times that of {few:,}"
            aim = 1.1 if stage == EPOCH else 1.25
            less = [many / few * seconds for seconds in less]
        ratio = median_ratio(more, less)
        rows.append(Row(f"{what}, {many:,} rows", reference, ratio, aim, False, figures))
    return rows


def log_rows(count: int) -> list[Row]:
    """Compare reading a long log with ten seconds, and with Python's own reader."""
    found = read_log_of(count)
    what = f"reading a log of {count:,} rows"
    ours, theirs = found.values()
    return [
        Row(what, "10 s", ours / 10, 1.0, False, {"s": ours}),
        Row(what, "Python's csv.reader alone", ours / theirs, figures=found),
    ]


def stages_of(sizes: list[int]) -> list[dict[str, float]]:
    """Return seconds of each stage, and megabytes, for each number of rows.

    Each is measured in a new process, one after the other. All processes start at the same time,
    because imports take longer than most stages.
    """
    folders = [linked_recording(rows, ("center",)) for rows in sizes]
    with tempfile.TemporaryDirectory(dir=OUT) as place:
        targets = {
            f"{number}": (run_stages, str(folder), f"{place}/{number}")
            for number, folder in enumerate(folders)
        }
        with contestants(targets, asleep=True) as measures:
            return [measure() for measure in measures.values()]


def run_stages(pipe: Connection, folder: str, place: str) -> None:
    """Train lenet for one epoch and time the stages; views and run go to `place`."""
    from datamodules.findings import report_lines
    from datamodules.recording import read_recordings
    from zoo.training.build import build_data
    from zoo.training.open_loop import predict_steering

    pipe.send(None)
    pipe.recv()
    seconds: dict[str, float] = {}

    @contextmanager
    def timed(stage: str) -> Iterator[None]:
        began = time.process_time()
        yield
        seconds[stage] = time.process_time() - began

    config = config_for(
        Path(folder),
        "model=lenet",
        "data.cameras=[center]",
        f"data.cache={place}/cache",
        "trainer.max_epochs=1",
        "trainer.accelerator=cpu",
    )
    config.callbacks = config.logger = {}
    with timed("reading the log"):
        recording = read_recordings(folder)
    with timed("its report"):
        report_lines(recording)
    data = build_data(config)
    with timed("building views"):
        data.load(Console(quiet=True))
    seconds["building views"] -= seconds["reading the log"] + seconds["its report"]
    with timed("train/validation similarity"):
        data.leaks()
    trainer, module, data = ready_to_fit(config, data, Path(place))
    with timed(EPOCH):
        trainer.fit(module, datamodule=data)
    with timed("validation"):
        predict_steering(module, data.evaluation_batches("val"))
    memory = {MEMORY: own_memory_mb()}
    give_back_freed_memory()
    pipe.send(seconds | memory | {IN_USE: own_memory_mb()})


def give_back_freed_memory() -> None:
    """Return freed memory from the allocator to the kernel, which only glibc can.

    See `zoo.training.host_settings.keep_freed_memory`. The freed memory that the allocator keeps
    grows over the first epochs and then stays constant, whatever the number of rows.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def own_memory_mb() -> float:
    """Return this process's memory without files, in MB; without Linux, its peak memory."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1e3
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def read_log_of(rows: int) -> dict[str, float]:
    """Return the seconds to read a log of a number of rows with three existing images each.

    The peer reads the same log with Python's csv module, and checks nothing.
    """
    from datamodules.recording import LOG_NAME, read_recordings

    small, long = linked_recording(100), OUT / "long"
    long.mkdir(parents=True, exist_ok=True)
    lines = (small / LOG_NAME).read_text().replace("IMG/", "").splitlines(keepends=True)
    with (long / LOG_NAME).open("w") as file:
        for _ in range(rows // len(lines)):
            file.writelines(lines)
    began = time.perf_counter()
    read_recordings(str(long), images=str(small / "IMG"))
    seconds, began = time.perf_counter() - began, time.perf_counter()
    with (long / LOG_NAME).open(newline="") as file:
        list(csv.reader(file))
    found = {"reading s": seconds, "csv.reader s": time.perf_counter() - began}
    (long / LOG_NAME).unlink()
    return found


def main(sizes: list[int], docs: bool) -> None:
    """Print a table with a column for each size; `docs` writes it into its page, too."""
    load = os.getloadavg()[0]
    head = ["seconds of a core", *(f"{rows:,} rows" for rows in sizes), "per row, last / first"]
    columns, rows = stages_of(sizes), []
    for stage in columns[0]:
        figures = [column[stage] for column in columns]
        in_mb = stage in MEGABYTES
        by_row = figures[-1] / figures[0] / (sizes[-1] / sizes[0])
        cells = [f"{figure:,.0f}" if in_mb else f"{figure:,.2f}" for figure in figures]
        rows.append([stage, *cells, "" if in_mb else f"{by_row:.2f}"])
    print_table(head, rows)
    if docs:
        text = (
            f"Written by `python benchmarks/growth.py {' '.join(map(str, sizes))} docs`. Seconds "
            f"are processor time of all threads, on {usable_cores()} cores with a load of "
            f"{load:.1f} before the start, one run each.\n\n"
        )
        write_between(DOCS, "growth", text + markdown_table(head, rows))


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    main(numbers, "docs" in sys.argv[1:]) if numbers else run_part(measure)
