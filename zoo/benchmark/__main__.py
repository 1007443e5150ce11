"""`drivezoo benchmark CKPT... [key=value ...]`: drive a suite of roads and compare.

CKPT... are the checkpoints of one entry, one for each training seed; or one of zero, mean, expert
and expert_late. Writes result.json and a page. With the `out=` of an interrupted benchmark it
resumes. `drivezoo benchmark verify RESULT` repeats some drives of a result.json and compares
them.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field
from rich.console import Console

from zoo.base.errors import InputError, UsageError
from zoo.benchmark.baselines import BASELINES
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.cli.closing_lines import print_written
from zoo.cli.command import CHECKPOINT, Command
from zoo.cli.console_progress import loading
from zoo.cli.run_command import run_command
from zoo.cli.stop_errors import StoppedError

if TYPE_CHECKING:
    from zoo.benchmark.benchmarked import Benchmarked

COMMAND = Command(__doc__, {"CKPT...": f"{CHECKPOINT}; or a baseline: {', '.join(BASELINES)}"})
VERIFY = "verify"

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions:
    """Options of a benchmark; `conf/benchmark.yaml` has their meanings and defaults."""

    suite: str
    split: Literal["test", "dev"]
    entry: str | None
    out: str | None
    workers: Annotated[int, Field(ge=0)]
    drives: Annotated[int, Field(ge=0)]
    table: str | None
    columns: str | None
    plot: str | None


def benchmark(names: list[str], options: BenchmarkOptions, console: Console) -> "Benchmarked":
    """Drive a suite with the checkpoints of an entry, and write the figures.

    Raises:
        InputError: a checkpoint or the suite cannot be used.
        StoppedError: on Ctrl-C.
    """
    # Reports a wrong path before torch is imported.
    names = [one if one in BASELINES else str(find_checkpoint(one)) for one in names]
    with loading():
        from zoo.base.new_folder import command_folder
        from zoo.benchmark.benchmarked import (
            Benchmarked,
            entry_result,
            table_columns,
            write_entry,
        )
        from zoo.benchmark.drivers import find_drivers
        from zoo.benchmark.drives import drive_suite
        from zoo.benchmark.finished_drives import NAME, FinishedDrives
        from zoo.benchmark.marks import reached_marks, write_marks
        from zoo.benchmark.suite import read_suite
        from zoo.runs.code_fingerprint import code_fingerprint
        from zoo.runs.table_files import check_plot, check_table, write_asked

        # Report wrong input before processes start.
        check_table(options.table, options.columns, table_columns())
        check_plot(options.plot)
        suite = read_suite(options.suite, options.split)
        drivers = find_drivers(names, suite)
    with command_folder(options.out, "benchmarks", resumed_by=NAME) as folder:
        code_fingerprint()  # kept: files that are edited during the drives are not in it
        finished = FinishedDrives(folder, drivers, suite)
        if finished.drives:
            line = f"{folder}: resumes after {len(finished.drives)} finished drives"
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        try:
            jobs = [(number, one) for number in range(len(drivers)) for one in suite.drives]
            mean = suite.mean_steering
            drives = drive_suite(drivers, jobs, mean, options.workers, console, finished)
        except KeyboardInterrupt:
            raise StoppedError(
                f"stopped after {len(finished.drives)} of {len(drivers) * len(suite.drives)} "
                f"drives; the same command with out={folder} resumes"
            ) from None
        result = entry_result(options.entry or drivers[0].model.lower(), suite, drivers, drives)
        written = write_entry(folder, result)
        finished.remove()
        reached = reached_marks(result.model_dump(), suite.marks)
        if reached:
            written += write_marks(folder, result.model_dump(), reached)
        found = Benchmarked(folder, result, reached, written)
        found.written.extend(write_asked(found, options.table, options.plot, options.columns))
        return found


def _next(result: Path, suite: str) -> list[object]:
    """Return the command that verifies a result; a suite of the user's is named in it."""
    named = [f"suite={suite}"] if suite.endswith((".yaml", ".yml")) else []
    return ["benchmark", VERIFY, result, *named]


def command(arguments: list[str]) -> None:
    """Read the arguments, then drive a suite or verify a result.

    Raises:
        InputError: see `benchmark`; or, after all files are written, the network steered NaN or a
            mark of the suite is missed.
    """
    names, options = COMMAND.read(arguments, BenchmarkOptions)
    console = Console(emoji=False)
    if names[0] != VERIFY:
        found = benchmark(names, options, console)
        from zoo.benchmark.benchmarked import print_benchmarked

        print_benchmarked(found, console)
        print_written(found.written, _next(found.written[0], options.suite), console)
        if found.problem:
            raise InputError(found.problem)
        return
    if len(names) != 2:
        raise UsageError("verify: name one result.json: drivezoo benchmark verify RESULT")
    if options.out or options.entry or options.table or options.plot:
        raise UsageError("verify: writes nothing; leave out entry=, out=, table= and plot=")
    from zoo.benchmark.verify import verify

    verify(Path(names[1]), options.suite, options.drives, options.workers, console)


if __name__ == "__main__":
    sys.exit(run_command("zoo.benchmark", command, sys.argv[1:]))
