"""`drivezoo benchmark`: drive a suite of roads and compare."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from zoo.base.command import command
from zoo.base.console_progress import loading
from zoo.base.errors import UsageError
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.results.benchmark_options import NO_CHECKPOINT, BenchmarkOptions

if TYPE_CHECKING:
    from zoo.results.benchmarked import Benchmarked

# Slow imports (torch, Panda3D) come late: --help and typos answer at once.


@command(outputs=True)
def benchmark(ckpt: str, *ckpts: str, options: BenchmarkOptions) -> "Benchmarked | None":
    """Drive a suite of roads and compare.

    CKPT... are the checkpoints of one entry, one for each training seed; or one of zero, mean,
    expert, expert_late, and human, for a person at the keyboard. Writes result.json and a page.
    With the `out=` of an interrupted benchmark it resumes. `drivezoo benchmark verify RESULT`
    repeats some drives of a result.json and compares them.

    Args:
        ckpt: checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes
            with drivezoo, such as lenet; or a baseline: zero, mean, expert, expert_late; or human.
        *ckpts: further checkpoints, which differ in the training seed.
        options: see `BenchmarkOptions`.

    Raises:
        UsageError: a key or value is wrong.
        InputError: a checkpoint or the suite cannot be used; or, after all files are written, the
            network steered NaN or a mark of the suite is missed.
    """
    console = Console(emoji=False)
    if ckpt == "verify":
        if len(ckpts) != 1:
            raise UsageError("verify: name one result.json: drivezoo benchmark verify RESULT")
        if options.out or options.entry or options.table or options.plot:
            raise UsageError("verify: writes nothing; leave out entry=, out=, table= and plot=")
        from zoo.results.checked_result import verify

        verify(Path(ckpts[0]), options.suite, options.drives, options.workers, console)
        return None
    from zoo.results.suite import suite_path

    # Report a wrong path or suite before torch is imported.
    names = [
        name if name in NO_CHECKPOINT else str(find_checkpoint(name)) for name in (ckpt, *ckpts)
    ]
    suite_path(options.suite)
    with loading():
        from zoo.results.benchmarked import score_entry
    return score_entry(names, options, console)


if __name__ == "__main__":
    benchmark.run()
