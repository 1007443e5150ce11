"""`python benchmarks/growth.py [ROWS...]`: time and memory of each stage, for any number of rows.

By default 3,000 and 30,000 rows; 300,000 take ten minutes. Pictures are links to the same few.
"""

import resource
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

from material import OUT, config_for, linked_recording
from rich.console import Console
from rich.table import Table
from timing import Row, contestant, let_threads_sleep, run_part

MEMORY = "memory beside the page cache, MB"
LOG_ROWS = 1_000_000


def measure(short: bool) -> list[Row]:
    """Each stage's time for ten times the rows; the memory; and a long log."""
    few, many = (200, 400) if short else (3_000, 30_000)
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
        if stage != MEMORY
    ]
    figures = {f"{few} rows MB": less[MEMORY], f"{many} rows MB": more[MEMORY]}
    memory = more[MEMORY] / less[MEMORY]
    figures = {f"{few} rows MB": less[MEMORY], f"{many} rows MB": more[MEMORY]}
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
    with contestant(run_stages, str(folder)) as ask:
        return ask()


def run_stages(pipe: Connection, folder: str) -> None:
    """A training of lenet, one epoch, as the main job takes its stages."""
    from datamodules.recording import read_recordings
    from datamodules.recording_report import report_lines
    from zoo.build import build_data, build_module, build_trainer
    from zoo.open_loop import predict_steering
    from zoo.pace import set_pace

    pipe.send(None)
    pipe.recv()
    seconds: dict[str, float] = {}

    @contextmanager
    def timed(stage: str) -> Iterator[None]:
        began = time.perf_counter()
        yield
        seconds[stage] = time.perf_counter() - began

    config = config_for(
        Path(folder),
        "model=lenet",
        "data.cameras=[center]",
        f"data.cache={OUT / 'growth'}",
        "trainer.max_epochs=1",
        "trainer.accelerator=cpu",
    )
    config.callbacks = config.logger = {}
    shutil.rmtree(OUT / "growth", ignore_errors=True)
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
    module = build_module(config, data, {})
    run = OUT / "run"
    run.mkdir(parents=True, exist_ok=True)
    trainer = build_trainer(config, run, has_validation=True)
    set_pace(config, module, data, trainer, Console(quiet=True))
    with timed("an epoch"):
        trainer.fit(module, datamodule=data)
    with timed("validation"):
        predict_steering(module, data.evaluation_batches("val"))
    pipe.send(seconds | {MEMORY: own_memory_mb()})


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


def main(sizes: list[int]) -> None:
    """A table of the sizes asked for, a column each."""
    let_threads_sleep()
    table = Table("seconds", *(f"{rows:,} rows" for rows in sizes))
    columns = [stages_of(rows) for rows in sizes]
    for stage in columns[0]:
        table.add_row(stage, *(f"{column[stage]:,.2f}" for column in columns))
    Console().print(table)


if __name__ == "__main__":
    numbers = [int(one) for one in sys.argv[1:] if one.isdigit()]
    main(numbers) if numbers else run_part(measure)
