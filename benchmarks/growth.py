"""`python benchmarks/growth.py [ROWS...] [docs]`: time and memory of each stage, for any number of
rows. Time is the processor's, of all threads: others on the machine do not make it grow.

By default 3,000 and 30,000 rows; 300,000 take ten minutes. Pictures are links to the same few.
`docs` writes the table into docs/growth.md, too.
"""

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

from material import OUT, config_for, linked_recording
from rich.console import Console
from rich.table import Table
from timing import Row, contestants, run_part

from datamodules.cores import usable_cores

MEMORY = "memory beside the page cache, MB"
IN_USE = "of that, not merely kept for the next step, MB"
MEGABYTES = (MEMORY, IN_USE)
LOG_ROWS = 1_000_000
DOCS = Path("docs/growth.md")


def measure(short: bool) -> list[Row]:
    """Each stage's time for ten times the rows; the memory; and a long log."""
    # From 4,000 rows on as many held-out rows are compared as with any number (`datamodules.leak`).
    few, many = (200, 400) if short else (4_000, 20_000)
    less, more = (stages_of(rows) for rows in (few, many))
    rows = [
        Row(
            f"{stage}, {many:,} rows",
            f"{many // few} times that of {few:,}",
            more[stage] / less[stage] / (many / few),
            1.25,
            False,
            {f"{few} rows s": less[stage], f"{many} rows s": more[stage]},
        )
        for stage in less
        if stage not in MEGABYTES
    ]
    figures = {f"{few} rows MB": less[MEMORY], f"{many} rows MB": more[MEMORY]}
    figures |= {f"{few} rows in use": less[IN_USE], f"{many} rows in use": more[IN_USE]}
    memory = more[MEMORY] / less[MEMORY]
    what = f"memory of training on {many:,} rows"
    rows.append(Row(what, f"on {few:,}", memory, 1.1, False, figures))
    count = 2_000 if short else LOG_ROWS
    seconds = read_log_of(count)
    what = f"reading a log of {count:,} rows"
    rows.append(Row(what, "10 s", seconds / 10, 1.0, False, {"s": seconds}))
    return rows


def stages_of(rows: int) -> dict[str, float]:
    """Seconds of each stage, and megabytes, in a process of its own."""
    folder = linked_recording(rows, ("center",))
    with (
        tempfile.TemporaryDirectory(dir=OUT) as place,
        contestants({"stages": (run_stages, str(folder), place)}, asleep=True) as ask,
    ):
        return ask["stages"]()


def run_stages(pipe: Connection, folder: str, place: str) -> None:
    """A training of lenet, one epoch, in the main job's stages; views and run go to `place`."""
    from datamodules.recording import read_recordings
    from datamodules.recording_report import report_lines
    from zoo.training.build import (
        build_data,
        build_feed,
        build_module,
        build_network,
        build_trainer,
    )
    from zoo.training.host_settings import set_up_process
    from zoo.training.open_loop import predict_steering
    from zoo.training.plan import make_plan

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
    with timed("how near the parts are"):
        data.leaks()
    console = Console(quiet=True)
    network = build_network(config, data.view, console)
    trainer = build_trainer(config, Path(place), has_validation=True)
    plan = make_plan(config, data, network, trainer, console)
    module = build_module(config, network, plan, {}, console)
    set_up_process(plan.threads)
    data = build_feed(data, plan, console)
    with timed("an epoch"):
        trainer.fit(module, datamodule=data)
    with timed("validation"):
        predict_steering(module, data.evaluation_batches("val"))
    memory = {MEMORY: own_memory_mb()}
    give_back_freed_memory()
    pipe.send(seconds | memory | {IN_USE: own_memory_mb()})


def give_back_freed_memory() -> None:
    """Return to the kernel what the allocator keeps, which glibc alone can.

    See `zoo.training.host_settings.keep_freed_memory`.

    What is kept grows over the first epochs and then no more, whatever the number of rows: blocks
    of a step's many sizes find their places.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def own_memory_mb() -> float:
    """What this process holds that no file backs; on other systems than Linux, all that it held."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) / 1e3
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def read_log_of(rows: int) -> float:
    """Seconds to read a log of so many rows of three pictures each, found on the disk."""
    from datamodules.recording import LOG_NAME, read_recordings

    small, long = linked_recording(100), OUT / "long"
    long.mkdir(parents=True, exist_ok=True)
    lines = (small / LOG_NAME).read_text().replace("IMG/", "").splitlines(keepends=True)
    with (long / LOG_NAME).open("w") as file:
        for _ in range(rows // len(lines)):
            file.writelines(lines)
    began = time.perf_counter()
    read_recordings(str(long), images=str(small / "IMG"))
    seconds = time.perf_counter() - began
    (long / LOG_NAME).unlink()
    return seconds


def main(sizes: list[int], docs: bool) -> None:
    """A table of the sizes asked for, a column each."""
    load = os.getloadavg()[0]
    head = ["seconds of a core", *(f"{rows:,} rows" for rows in sizes), "a row, last against first"]
    columns = [stages_of(rows) for rows in sizes]
    lines = []
    for stage in columns[0]:
        figures = [column[stage] for column in columns]
        cells = [f"{one:,.0f}" if stage in MEGABYTES else f"{one:,.2f}" for one in figures]
        by_row = figures[-1] / figures[0] / (sizes[-1] / sizes[0])
        lines.append([stage, *cells, "" if stage in MEGABYTES else f"{by_row:.2f}"])
    table = Table(*head)
    for line in lines:
        table.add_row(*line)
    Console().print(table)
    if docs:
        write_docs(sizes, head, lines, load)


def write_docs(sizes: list[int], head: list[str], lines: list[list[str]], load: float) -> None:
    """The table as a page."""
    rule = ["---", *("---:" for _ in head[1:])]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *lines))
    DOCS.write_text(
        "# How cost grows with the rows\n\n"
        f"`python benchmarks/growth.py {' '.join(map(str, sizes))} docs` wrote this page: the main "
        "job's stages, `model=lenet`, one epoch of centre pictures, which are links to the same "
        f"few. Seconds are of processor time, all threads together: {usable_cores()} cores, load "
        f"{load:.1f} before it began, one run each.\n\n"
        f"{table}\n\n"
        "The last column is the time a row takes in the longest recording, as a multiple of the "
        "shortest one's: 1 is linear, less is a start-up's cost shared out. How near the parts "
        "are is told from 20,000 training rows at most, and from every sampled row's neighbours. "
        "Views are in files, which the page cache holds as far as there is room. The allocator "
        "keeps what a step has freed for the next one; the last line is without that.\n"
    )


if __name__ == "__main__":
    numbers = [int(one) for one in sys.argv[1:] if one.isdigit()]
    main(numbers, "docs" in sys.argv[1:]) if numbers else run_part(measure)
