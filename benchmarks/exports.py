"""`python benchmarks/measurements.py exports RECORDING`: measure the files of `drivezoo export`.

It compiles the C files by gcc for this machine, and by cross compilers for 32-bit x86 and for ARM,
whose program runs under qemu. It stops at a warning. A compiler that is not installed leaves its
column empty. Debian: apt install gcc-i686-linux-gnu
gcc-arm-linux-gnueabihf libc6-dev-i386-cross libc6-dev-armhf-cross qemu-user. (Its gcc-multilib, for
`gcc -m32`, cannot be installed together with cross compilers.)
"""

import subprocess
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

import numpy as np
import torch

from benchmarks.material import frames_of, random_checkpoint
from benchmarks.measuring import markdown_table, seconds_of, write_between
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.policy_base import Policy
from zoo.driving.metrics import measure
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.export.exported_file import (
    CFile,
    ExportedFile,
    Int8CFile,
    Int8OnnxFile,
    OnnxFile,
)
from zoo.models.make_network import multiply_adds

PAGE = Path("docs/onto_the_car.md")
RANDOM = ("efficientnet_lite0",)  # networks without a checkpoint: random weights, no drives
NETWORKS = ("linear", "tiny41", "tiny63", "lenet", "pilotnet", *RANDOM)
CHECKPOINT = "checkpoint"
FILES: dict[str, type[ExportedFile]] = {
    "C": CFile,
    "C, int8": Int8CFile,
    "ONNX": OnnxFile,
    "ONNX, int8": Int8OnnxFile,
}
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror")
ARM = "arm-linux-gnueabihf-"
BUILDS = {
    "x86-64": (["gcc"], []),
    "32-bit x86": (["i686-linux-gnu-gcc", "-static"], []),
    "ARM": ([f"{ARM}gcc", "-static"], ["qemu-arm"]),
}
EMULATED = 300_000_000  # most multiply-adds under qemu, a hundred times slower: fewer frames
SMALL = ("-std=c99", "-Os", "-mthumb", "-c")  # for the size on a microcontroller
# Reads frames and speeds from its input, and prints a steering for each.
MAIN = """
#include "steer.h"
#include <stdio.h>
static uint8_t rgb[3 * STEER_WIDTH * STEER_HEIGHT];
int main(void)
{
    float speed;
    while (fread(&speed, 4, 1, stdin) == 1 && fread(rgb, sizeof rgb, 1, stdin) == 1) {
        printf("%.9g\\n", (double)steer(rgb, STEER_WIDTH, STEER_HEIGHT, speed));
    }
    return 0;
}
"""
HEAD = ["network", "file", "size, kB", "memory, kB", "multiply-adds", "ms"]
HEAD += [*(f"difference, {build}" for build in BUILDS), "autonomy, %", "cross-track error, m"]


def exports(
    folder: str, *networks: str, frames: str = "1000", only: str = "", laps: str = "1"
) -> None:
    """Measure the files of `drivezoo export`: `exports RECORDING [NETWORK...] [frames=1000]`.

    Of all networks that come with drivezoo it writes the table of `docs/onto_the_car.md`; with
    names, or `only="C;ONNX, int8" laps=0`, it prints those rows.

    Args:
        folder: recording on which the files are compared with the checkpoint, and calibrated.
        *networks: names of networks; none for all.
        frames: number of frames.
        only: files to measure, such as `C;ONNX, int8`; empty for all.
        laps: laps of the lake that each file drives; 0 for none.
    """
    torch.set_num_threads(1)
    images, speeds, _ = frames_of(folder, int(frames))
    chosen = only.split(";") if only else [CHECKPOINT, *FILES]
    rows = []
    for name in networks or NETWORKS:
        for row in _rows(name, folder, images, speeds, chosen, float(laps)):
            print(" | ".join(row), flush=True)
            rows.append(row)
    if not networks and not only and float(laps):
        write_between(PAGE, "exports", markdown_table(HEAD, rows, left=2))


def _rows(
    name: str,
    folder: str,
    frames: list[np.ndarray],
    speeds: np.ndarray,
    files: list[str],
    laps: float,
) -> Iterator[list[str]]:
    """Yield a row for each file."""
    checkpoint = load_checkpoint(name) if name not in RANDOM else random_checkpoint(name)
    height, width, channels = checkpoint.view.shape
    operations = multiply_adds(checkpoint.network, (channels, height, width))
    own = CheckpointPolicy(checkpoint)
    wanted = _answers(own, frames, speeds)
    for file in files:
        policy: Policy = own
        sizes, found = ["-", "-"], {}
        if file != CHECKPOINT:
            with TemporaryDirectory() as place:
                path = Path(place, "steer").with_suffix(Path(FILES[file].default).suffix)
                exported = FILES[file](checkpoint, path, folder)
                try:
                    contents = exported.files("")
                except InputError:  # a layer that C cannot have
                    continue
                for suffix, content in contents.items():
                    path.with_suffix(suffix).write_bytes(content)
                policy = exported.policy(path)
                if path.suffix == ".c":
                    sizes = _kilobytes(path.parent)
                    for build in BUILDS:
                        found[build] = _steering(path.parent, build, frames, speeds, operations)
                else:
                    sizes = [f"{path.stat().st_size / 1000:,.1f}", "-"]
                    found["x86-64"] = _answers(policy, frames, speeds)
        row = [name, file, *sizes, f"{operations:,}", _ms(policy, frames)]
        row += [_difference(found.get(build), wanted) for build in BUILDS]
        yield [*row, *(["-", "-"] if name in RANDOM or not laps else _drives(policy, laps))]


def _difference(found: np.ndarray | None, wanted: np.ndarray) -> str:
    return "-" if found is None else f"{np.abs(found - wanted[: len(found)]).max():.1e}"


def _answers(policy: Policy, frames: list[np.ndarray], speeds: np.ndarray) -> np.ndarray:
    return np.array([policy(*pair).steering for pair in zip(frames, speeds, strict=True)])


def _steering(
    folder: Path, build: str, frames: list[np.ndarray], speeds: np.ndarray, operations: int
) -> np.ndarray | None:
    """Return the steering of a compiled program for frames; None without its compiler."""
    compiler, run = BUILDS[build]
    if not all(which(word[0]) for word in (compiler, run) if word):
        return None
    (folder / "main.c").write_text(MAIN)
    program = folder / "program"
    files = [str(folder / name) for name in ("steer.c", "main.c")]
    subprocess.run([*compiler, *STRICT, *files, "-o", str(program)], check=True)
    count = EMULATED // operations if run else len(frames)
    pairs = list(zip(speeds, frames, strict=True))[:count]
    data = b"".join(np.float32(speed).tobytes() + frame.tobytes() for speed, frame in pairs)
    done = subprocess.run([*run, str(program)], input=data, capture_output=True, check=True)
    return np.array(done.stdout.split(), float).clip(-1, 1)


def _kilobytes(folder: Path) -> list[str]:
    """Return kB of code and constants, and of variables, in ARM's Thumb instructions."""
    if not which(f"{ARM}gcc"):
        return ["-", "-"]
    object_file = str(folder / "steer.o")
    subprocess.run([f"{ARM}gcc", *SMALL, str(folder / "steer.c"), "-o", object_file], check=True)
    printed = subprocess.run([f"{ARM}size", object_file], capture_output=True, check=True).stdout
    text, data, variables = map(int, printed.decode().splitlines()[1].split()[:3])
    return [f"{(text + data) / 1000:,.1f}", f"{(data + variables) / 1000:,.1f}"]


def _ms(policy: Policy, frames: list[np.ndarray]) -> str:
    """Return the median of the processor's milliseconds for a frame."""
    seconds = [seconds_of(partial(policy, one, 9.0), time.process_time) for one in frames[:100]]
    return f"{1000 * np.median(seconds):.2f}"


def _drives(policy: Policy, laps: float) -> list[str]:
    """Return the autonomy on the lake in percent, and the mean cross-track error."""
    figures = measure(*all_drives(policy, [Scenario("lake", laps=laps)]))
    return [f"{100 * figures['autonomy']:.1f}", f"{figures['cte_mean_m']:.3f}"]
