"""Drives of an entry on the roads of a suite, from the options to the files."""

from rich.console import Console

from zoo.base.errors import StoppedError
from zoo.base.new_folder import command_folder
from zoo.benchmark.benchmark_options import BenchmarkOptions
from zoo.benchmark.benchmarked import Benchmarked, entry_result, table_columns, write_entry
from zoo.benchmark.drivers import find_drivers
from zoo.benchmark.drives import UNFINISHED, FinishedDrives, drive_suite
from zoo.benchmark.marks import reached_marks, write_marks
from zoo.benchmark.suite import read_suite
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.table_files import check_plot, check_table, write_asked


def score_entry(names: list[str], options: BenchmarkOptions, console: Console) -> Benchmarked:
    """Drive a suite with the checkpoints of an entry, and write the figures.

    Raises:
        InputError: a checkpoint or the suite cannot be used.
        StoppedError: on Ctrl-C.
    """
    # Report wrong input before processes start.
    check_table(options.table, options.columns, table_columns())
    check_plot(options.plot)
    suite = read_suite(options.suite, options.split)
    drivers = find_drivers(names, suite)
    with command_folder(options.out, "benchmarks", resumed_by=UNFINISHED) as folder:
        code_fingerprint()  # kept: files that are edited during the drives are not in it
        finished = FinishedDrives(folder, drivers, suite)
        if finished.drives:
            line = f"{folder}: resumes after {len(finished.drives)} finished drives"
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        try:
            jobs = [(number, one) for number in range(len(drivers)) for one in suite.drives]
            mean = suite.mean_steering
            how = console, finished, options.executor
            drives = drive_suite(drivers, jobs, mean, options.workers, *how)
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
        found = Benchmarked(folder, result, reached, written, options.suite)
        found.written.extend(write_asked(found, options.table, options.plot, options.columns))
        return found
