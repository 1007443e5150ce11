"""Measure time and memory by stage and rows: `python benchmarks/growth.py [ROWS...] [docs]`.

Time is processor time of all threads, so that other processes do not change it. 300,000 rows take
ten minutes. Images are hard links to the same few files. `docs` also writes docs/growth.md.
"""

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

import psutil
from rich.console import Console

from benchmarks import measuring
from benchmarks.material import OUT, config_for, linked_recording, ready_to_fit
from zoo.base.cores import usable_cores

MEMORY = "memory without the page cache, MB"
EPOCH = "an epoch"
DOCS = Path("docs/growth.md")


def measure(short: bool) -> list[measuring.Row]:
    """Compare an epoch of many rows with one of few; its time counts for each row."""
    few, many, rounds = (200, 400, 1) if short else (4_000, 20_000, 2)
    epochs = [stages[EPOCH] for stages in stages_of([few, many] * rounds)]
    figures = measuring.medians({f"{few} rows s": epochs[::2], f"{many} rows s": epochs[1::2]})
    ratio = measuring.ratios(epochs[1::2], [many / few * seconds for seconds in epochs[::2]])
    reference = f"{many // few} times that of {few:,}"
    return [measuring.Row(f"{EPOCH}, {many:,} rows", reference, ratio, 1.1, False, figures)]


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
        with measuring.contestants(targets, asleep=targets) as measures:
            return [measure() for measure in measures.values()]


def run_stages(pipe: Connection, folder: str, place: str) -> None:
    """Train lenet for one epoch and time the stages; views and run go to `place`."""
    from datamodules.looking.findings import report_lines
    from datamodules.recording_format import read_recordings
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
    memory = psutil.Process().memory_info()
    pipe.send(seconds | {MEMORY: (memory.rss - memory.shared) / 1e6})


def main(sizes: list[int], docs: bool) -> None:
    """Print a table with a column for each size; `docs` writes it into its page, too."""
    load = os.getloadavg()[0]
    head = ["seconds of a core", *(f"{rows:,} rows" for rows in sizes), "per row, last / first"]
    columns, rows = stages_of(sizes), []
    for stage in columns[0]:
        figures = [column[stage] for column in columns]
        in_mb = stage == MEMORY
        by_row = figures[-1] / figures[0] / (sizes[-1] / sizes[0])
        cells = [f"{figure:,.0f}" if in_mb else f"{figure:,.2f}" for figure in figures]
        rows.append([stage, *cells, "" if in_mb else f"{by_row:.2f}"])
    measuring.print_table(head, rows)
    if docs:
        text = (
            f"Written by `python benchmarks/growth.py {' '.join(map(str, sizes))} docs`. Seconds "
            f"are processor time of all threads, on {usable_cores()} cores with a load of "
            f"{load:.1f} before the start, one run each.\n\n"
        )
        measuring.write_between(DOCS, "growth", text + measuring.markdown_table(head, rows))


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    main(numbers or [4_000, 20_000], "docs" in sys.argv[1:])
