"""An entry of the benchmark: its drives as a result, and the files that describe it."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from zoo.benchmark.drivers import Driver
from zoo.benchmark.page import write_page
from zoo.benchmark.result import (
    VERSION,
    BenchmarkResult,
    DriveRecord,
    DriverRecord,
    digest_of_drives,
    write_result,
)
from zoo.benchmark.suite import Suite
from zoo.benchmark.summary import summarize_drives
from zoo.runs.code_fingerprint import code_fingerprint


def entry_result(
    name: str, suite: Suite, drivers: Sequence[Driver], drives: Sequence[DriveRecord]
) -> BenchmarkResult:
    """Return the result of an entry, with the figures of its groups.

    Args:
        name: name of the entry.
        suite: suite that was driven.
        drivers: drivers of the entry.
        drives: drives of each driver in turn.
    """
    return BenchmarkResult(
        version=VERSION,
        suite=suite.name,
        roads=suite.roads,
        code=code_fingerprint(),
        entry=name,
        checkpoints=[DriverRecord(**asdict(one)) for one in drivers],
        drives=list(drives),
        **vars(summarize_drives(drives)),
        digest=digest_of_drives(drives),
    )


def write_entry(folder: Path, result: BenchmarkResult) -> list[Path]:
    """Write `result.json` and `benchmark.html`; return their paths."""
    return [write_result(folder, result), write_page(folder, result)]


def nan_line(result: BenchmarkResult) -> str:
    """Return a warning if the network steered NaN in a drive; empty if it did not."""
    lost = [one for one in result.drives if one.figures.get("nan_frames")]
    if not lost:
        return ""
    frames = sum(int(one.figures["nan_frames"] or 0) for one in lost)
    return (
        f"{result.checkpoints[lost[0].checkpoint].file}: the network steered NaN in {frames:,} "
        "frames: these figures are not the network's; train again with a smaller optim.lr"
    )
