"""Measurements of recordings: `python benchmarks/recordings.py NAME ...`, one function each."""

import contextlib
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from benchmarks.marked_page import markdown_table
from benchmarks.material import CACHE, config_for, linked_recording, loaded_data, pictures
from benchmarks.measuring import print_table, run_named
from datamodules.image import decode_image, read_image
from datamodules.recording import Recording, read_recordings
from datamodules.view import View

LABELS = ("steering", "throttle", "brake", "speed_mph", "time_s")
ROWS_PER_S, CAMERAS, SHARD_BYTES = 15, 3, 128e6
GB_MONTH, GET, PUT = 0.023, 0.0004 / 1000, 0.005 / 1000  # US dollars: S3 in us-east-1, first tier
AIM = 200_000  # samples per second of a GPU
VIEW = View((40, 20), "rgb", (66, 200))
EPOCHS = 4
# Views of 100 x 320 x 3 bytes: with a small network and large images, feeding is the main work.
LARGE_VIEWS = (
    "model=lenet",
    "model.width=0.25",
    "model.colour=rgb",
    "model.size=[100,320]",
    "data.crop=[40,20]",
    "augment=[]",
    "callbacks=published",
    "data.samples_per_epoch=6400",  # drawn from all rows
    f"trainer.max_epochs={EPOCHS}",
)
CGROUPS = Path("/sys/fs/cgroup")


def exchange(*folders: str) -> None:
    """Measure what a recording is after an exchange, and its costs: `exchange FOLDER...`.

    Converts the recording to LeRobot and to Donkeycar and back, in a temporary folder, and prints
    as Markdown whether the log is equal to the bit, how far every tenth row's images differ, sizes
    and processor time (of the command and its ffmpeg).
    """
    from datamodules.formats.donkeycar import export_tub
    from datamodules.formats.lerobot_export import export_lerobot
    from datamodules.formats.recording_writer import convert_to_recording

    recording, rows = read_recordings(list(folders)), []
    with tempfile.TemporaryDirectory() as temporary:
        for name, there in (("LeRobot", export_lerobot), ("Donkeycar", export_tub)):
            out, again = Path(temporary) / name, Path(temporary) / f"{name}_again"
            before = sum(os.times()[:4])
            there(recording, out)
            between = sum(os.times()[:4])
            convert_to_recording(out, again)
            seconds = [between - before, sum(os.times()[:4]) - between]
            size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6
            cells = [name, *compared(recording, read_recordings(str(again))), f"{size:.0f}"]
            rows.append([*cells, *(f"{value:.0f}" for value in seconds)])
    head = ["to", "log equal", "mean difference, of 255", "worst image", "PSNR, dB", "worst image"]
    print(markdown_table([*head, "size, MB", "out, s", "back, s"], rows, left=2))


def compared(before: Recording, after: Recording) -> list[str]:
    """Return the cells of a comparison: labels, then every tenth row's images."""
    equal = all(np.array_equal(getattr(before, name), getattr(after, name)) for name in LABELS)
    pairs = zip(before.images[::10].flat, after.images[::10].flat, strict=True)
    apart = [read_image(new).astype(float) - read_image(old) for old, new in pairs if new]
    means = [np.abs(difference).mean() for difference in apart]
    squares = [np.square(difference).mean() for difference in apart]
    psnr = [
        f"{10 * np.log10(255**2 / square):.1f}" if square else "equal"
        for square in (np.mean(squares), np.max(squares))
    ]
    return ["yes" if equal else "no", f"{np.mean(means):.2f}", f"{np.max(means):.2f}", *psnr]


def storage(folder: str | None = None, hours: str = "10000") -> None:
    """Measure the figures of `docs/scale.md`: `storage [RECORDING] [hours=N]`.

    These are the bytes of an image as recorded and as a view, the speed at which one core decodes
    them, and the storage of N hours of three cameras.
    """
    files = sorted(Path(folder, "IMG").glob("*.jpg")) if folder else [*chain(*pictures().values())]
    random.Random(0).shuffle(files)
    cv2.setNumThreads(1)
    recorded = [np.frombuffer(file.read_bytes(), np.uint8) for file in files[:600]]
    views = [VIEW(decode_image(data.tobytes())) for data in recorded]

    def encoded(kind: str, *settings: int) -> list[np.ndarray]:
        return [cv2.imencode(kind, view[:, :, ::-1], settings)[1] for view in views]

    def decoded(data: np.ndarray) -> np.ndarray:
        return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)

    kinds: dict[str, tuple[list, Callable | None]] = {
        "JPEG, as recorded": (recorded, lambda data: VIEW(decode_image(data.tobytes()))),
        "view, JPEG of quality 95": (encoded(".jpg", cv2.IMWRITE_JPEG_QUALITY, 95), decoded),
        "view, PNG": (encoded(".png"), decoded),
        "view, uncompressed": (views, None),
    }
    count = float(hours) * 3600 * ROWS_PER_S * CAMERAS
    print(f"{count:,.0f} images; a GPU that takes {AIM:,} samples/s; by kind of storage:")
    rows = []
    for name, (data, decode) in kinds.items():
        size = float(np.mean([item.nbytes for item in data]))
        total = size * count
        cells = [name, f"{size:,.0f}", f"{total / 1e12:,.1f} TB", f"${total / 1e9 * GB_MONTH:,.0f}"]
        cells += [f"${total / SHARD_BYTES * GET:,.2f}", f"{AIM * size * 8 / 1e9:,.0f} Gbit/s"]
        rows.append([*cells, "0" if decode is None else f"{AIM / rate(data, decode):,.0f}"])
    head = ["stored", "bytes", "total", "per month", "GETs of an epoch", "network of a GPU"]
    print_table([*head, "its cores"], rows)
    size = float(np.mean([item.nbytes for item in recorded]))
    shards, seconds = size * count / SHARD_BYTES, SHARD_BYTES / size / CAMERAS / ROWS_PER_S
    print(
        f"a shard of {SHARD_BYTES / 1e6:.0f} MB as recorded: {SHARD_BYTES / size:,.0f} images, "
        f"{seconds:,.0f} s of driving; {shards:,.0f} shards, ${shards * PUT:,.2f} to upload\n"
        f"one object per image: ${count * PUT:,.0f} to upload, ${count * GET:,.0f} per epoch"
    )


def rate(data: list[np.ndarray], decode: Callable) -> float:
    """Return the images per second of processor time on one core, the best of five rounds."""
    seconds = []
    for _ in range(5):
        began = time.process_time()
        for item in data:
            decode(item)
        seconds.append(time.process_time() - began)
    return len(data) / min(seconds)


def beyond_memory(rows: str = "12000", limit_mb: str = "1500") -> None:
    """Train on more views than memory: `beyond_memory [rows=N] [limit_mb=N]`.

    The training reads the view cache under a limit on the memory of the whole process, including
    its page cache. The limit is that of a control group (v1 or v2), which usually only root can
    create. Without one the process is measured but not limited. A recording with a quarter of the
    rows shows which memory grows with the rows.
    """
    many, limit = int(rows), int(limit_mb)
    lines = [train(*job) for job in ((many // 4, None), (many, None), (many, limit))]
    head = ["rows", "views", "limit", "its own memory, by epoch", "mapped", "held", "samples/s"]
    print_table(head, lines)
    tracemalloc.start()
    recording = read_recordings(str(linked_recording(many)))
    held, _ = tracemalloc.get_traced_memory()  # mostly for paths
    print(f"memory of a row: {held / len(recording):,.0f} bytes")


def train(rows: int, limit_mb: int | None) -> list[str]:
    """Train on a recording with a number of rows in a new process; return its line of the table.

    Its own memory is the peak without files in each epoch, of which the first includes loading;
    *held* is the peak of the control group.
    """
    folder = linked_recording(rows)
    data = build_views(folder)
    run = Path(CACHE).parent / "beyond_memory"
    shutil.rmtree(run, ignore_errors=True)
    command = [sys.executable, "-m", "zoo", *LARGE_VIEWS, f"data.root={folder}", "data=recording"]
    command += [f"data.cache={CACHE}", "score=none", "logger=csv", f"hydra.run.dir={run}"]
    with control_group(limit_mb) as group:
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: (
                group and group.joinpath("cgroup.procs").write_text(str(os.getpid()))
            ),
        )
        anonymous, mapped, ends = watch(process, run / "metrics.csv")
        output, held = process.stdout.read(), peak_mb(group)
    if process.returncode:
        sys.exit(f"the training ended with {process.returncode}; raise limit_mb= if memory ran out")
    if limit_mb and group is None:
        print("no control group could be created here: memory is measured, not limited")
    rates = [line.split()[-2] for line in output.splitlines() if line.startswith("epoch ")]
    peaks = [max(anonymous[at:end]) for at, end in zip([0, *ends[:-1]], ends, strict=True)]
    own = f"{', '.join(f'{peak:,.0f}' for peak in peaks)} MB"
    print(f"{rows:,} rows: {own}, {rates[-1]} samples/s")
    limit = "none" if group is None else f"{limit_mb:,} MB"
    return [f"{rows:,}", f"{data:,.0f} MB", limit, own, f"{max(mapped):,.0f} MB", held, rates[-1]]


def build_views(folder: Path) -> float:
    """Decode images that are not in the cache, drop it from memory, and return its megabytes."""
    data = loaded_data(config_for(folder, *LARGE_VIEWS))
    for file in Path(CACHE).glob("*.npy"):  # so that the next reader is charged for it
        descriptor = os.open(file, os.O_RDONLY)
        os.fsync(descriptor)
        os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        os.close(descriptor)
    return sum(file.nbytes for file in data.views.files) / 1e6


def watch(process: subprocess.Popen, log: Path) -> tuple[list[float], list[float], list[int]]:
    """Return megabytes without files and of mapped files, ten times per second.

    The third result is the number of these samples at the end of each epoch.
    """
    anonymous, mapped, epochs = [0.0], [0.0], []
    while process.poll() is None:
        with contextlib.suppress(OSError, KeyError):  # the process has just ended
            text = Path(f"/proc/{process.pid}/status").read_text()
            fields = dict(line.split(":", 1) for line in text.splitlines())
            anonymous.append(int(fields["RssAnon"].split()[0]) / 1000)
            mapped.append(int(fields["RssFile"].split()[0]) / 1000)
        done = log.read_text().count("\n") if log.is_file() else 0
        # After the header, an epoch has three lines: rate, validation and training.
        if (done - 1) // 3 > len(epochs):
            epochs.append(len(anonymous))
        time.sleep(0.1)
    return anonymous, mapped, epochs or [len(anonymous)]


@contextlib.contextmanager
def control_group(limit_mb: int | None) -> Iterator[Path | None]:
    """Yield the folder of a control group with limited memory, page cache included.

    It is None without a limit, or where no group can be created.
    """
    first = (CGROUPS / "memory").is_dir()
    group = (CGROUPS / "memory" if first else CGROUPS) / f"drivezoo-{os.getpid()}"
    try:
        if limit_mb is None:
            raise OSError
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


def peak_mb(group: Path | None) -> str:
    """Return the peak memory of a group; empty without one."""
    for name in ("memory.max_usage_in_bytes", "memory.peak"):
        if group is not None and (group / name).is_file():
            return f"{int((group / name).read_text()) / 1e6:,.0f} MB"
    return ""


if __name__ == "__main__":
    run_named(beyond_memory, exchange, storage)
