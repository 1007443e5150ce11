"""Train on more views than memory: `beyond_memory.py [short] [rows=N] [limit_mb=N]`.

The training reads the view cache under a limit on the memory of the whole process, including its
page cache. The limit is that of a control group (v1 or v2), which usually only root can create.
Without one the process is measured but not limited. A recording with a quarter of the rows shows
which memory grows with the rows.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from material import CACHE, config_for, linked_recording
from rich.console import Console
from rich.table import Table

from datamodules.recording import read_recordings
from zoo.training.build import build_data

ROWS, LIMIT_MB = 12_000, 1_500
# Views of 100 x 320 x 3 bytes: with a small network and large images, feeding is the main work.
MODEL = (
    "model=lenet",
    "model.width=0.25",
    "model.colour=rgb",
    "model.size=[100,320]",
    "data.crop=[40,20]",
)
EPOCHS, SAMPLES = 4, 6_400  # samples of an epoch are drawn from all rows
CGROUPS = Path("/sys/fs/cgroup")


@dataclass(frozen=True)
class Watched:
    """Memory and speed of a training.

    Attributes:
        rows: rows of the recording.
        views_mb: size of the files of its views.
        anonymous_mb: peak of memory without files in each epoch; the first includes loading.
        mapped_mb: peak of mapped files in memory.
        held_mb: peak memory of the control group; None without one.
        limited: whether it ran under the limit.
        samples_per_s: samples per second of the last epoch.
    """

    rows: int
    views_mb: float
    anonymous_mb: list[float]
    mapped_mb: float
    held_mb: float | None
    limited: bool
    samples_per_s: str


def main(arguments: list[str]) -> None:
    options = dict(one.split("=") for one in arguments if "=" in one)
    rows = int(options.get("rows", 800 if "short" in arguments else ROWS))
    limit_mb = int(options.get("limit_mb", LIMIT_MB))
    console = Console(soft_wrap=True)
    found = [
        train(one, limit, console)
        for one, limit in ((rows // 4, None), (rows, None), (rows, limit_mb))
    ]
    table = Table(
        "rows", "views", "limit", "its own memory, by epoch", "mapped", "held", "samples/s"
    )
    for one in found:
        table.add_row(
            f"{one.rows:,}",
            f"{one.views_mb:,.0f} MB",
            f"{limit_mb:,} MB" if one.limited else "none",
            ", ".join(f"{epoch:,.0f}" for epoch in one.anonymous_mb) + " MB",
            f"{one.mapped_mb:,.0f} MB",
            "" if one.held_mb is None else f"{one.held_mb:,.0f} MB",
            one.samples_per_s,
        )
    console.print(table)
    console.print(f"memory of a row: {row_bytes(linked_recording(rows)):,.0f} bytes")


def row_bytes(folder: Path) -> float:
    """Return the bytes that Python and numpy allocate per row of a recording, mostly for paths."""
    tracemalloc.start()
    recording = read_recordings(str(folder))
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return held / len(recording)


def train(rows: int, limit_mb: int | None, console: Console) -> Watched:
    """Train on a recording with a number of rows in a new process, and measure its memory."""
    folder = linked_recording(rows)
    overrides = (*MODEL, "augment=[]", f"trainer.max_epochs={EPOCHS}", "callbacks=published")
    overrides += (f"data.samples_per_epoch={SAMPLES}",)
    data = build_data(config_for(folder, *overrides))
    data.load(Console(quiet=True))  # decodes images that are not in the cache
    views_mb = sum(file.nbytes for file in data.views.files) / 1e6
    del data
    for file in Path(CACHE).glob("*.npy"):
        forget(file)
    run = Path(CACHE).parent / "beyond_memory"
    shutil.rmtree(run, ignore_errors=True)
    command = [
        sys.executable,
        "-m",
        "zoo",
        *overrides,
        f"data.root={folder}",
        f"data.cache={CACHE}",
    ]
    command += ["score=none", "logger=csv", "data=recording", f"hydra.run.dir={run}"]
    with control_group(limit_mb) as group:
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: (
                group and group.joinpath("cgroup.procs").write_text(str(os.getpid()))
            ),
        )
        anonymous, mapped, epoch_ends = watch(process)
        output = process.stdout.read()
        held = peak_mb(group)
    if process.returncode:
        raise SystemExit(
            f"training ended with {process.returncode}; raise limit_mb= if it ran out of memory"
        )
    rates = [line.split()[-2] for line in output.splitlines() if line.startswith("epoch ")]
    if limit_mb and group is None:
        console.print("no control group could be created here: memory is measured, not limited")
    starts = [0, *epoch_ends[:-1]]
    ends = [max(anonymous[one:end]) for one, end in zip(starts, epoch_ends, strict=True)]
    console.print(
        f"{rows:,} rows: "
        + ", ".join(f"{one:,.0f}" for one in ends)
        + f" MB, {rates[-1]} samples/s"
    )
    return Watched(rows, views_mb, ends, max(mapped), held, group is not None, rates[-1])


def watch(process: subprocess.Popen) -> tuple[list[float], list[float], list[int]]:
    """Return megabytes without files and of mapped files, ten times per second.

    The third result is the number of these samples at the end of each epoch.
    """
    anonymous, mapped, epochs = [0.0], [0.0], []
    log = Path(CACHE).parent / "beyond_memory" / "metrics.csv"
    log.unlink(missing_ok=True)
    while process.poll() is None:
        with contextlib.suppress(OSError, KeyError):  # the process has just ended
            fields = dict(
                line.split(":", 1)
                for line in Path(f"/proc/{process.pid}/status").read_text().splitlines()
            )
            anonymous.append(int(fields["RssAnon"].split()[0]) / 1000)
            mapped.append(int(fields["RssFile"].split()[0]) / 1000)
        done = log.read_text().count("\n") if log.is_file() else 0
        # After the header, an epoch has three lines: rate, validation and training.
        if (done - 1) // 3 > len(epochs):
            epochs.append(len(anonymous))
        time.sleep(0.1)
    return anonymous, mapped, epochs or [len(anonymous)]


def forget(file: Path) -> None:
    """Drop a file from the page cache, so that the next reader is charged for it."""
    descriptor = os.open(file, os.O_RDONLY)
    os.fsync(descriptor)
    os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(descriptor)


@contextlib.contextmanager
def control_group(limit_mb: int | None) -> Iterator[Path | None]:
    """Yield the folder of a control group with limited memory, page cache included.

    It is None without a limit, or where no group can be created.
    """
    if limit_mb is None:
        yield None
        return
    first = (CGROUPS / "memory").is_dir()
    group = (CGROUPS / "memory" if first else CGROUPS) / f"drivezoo-{os.getpid()}"
    try:
        group.mkdir()
        name = "memory.limit_in_bytes" if first else "memory.max"
        (group / name).write_text(str(limit_mb * 1_000_000))
    except OSError:
        with contextlib.suppress(OSError):
            group.rmdir()
        yield None
        return
    try:
        yield group
    finally:
        group.rmdir()


def peak_mb(group: Path | None) -> float | None:
    """Return the peak memory of a group in megabytes."""
    for name in ("memory.max_usage_in_bytes", "memory.peak"):
        if group is not None and (group / name).is_file():
            return int((group / name).read_text()) / 1e6
    return None


if __name__ == "__main__":
    main(sys.argv[1:])
