"""`python benchmarks/measurements.py c_files RECORDING`: measure the C files of `drivezoo export`.

It compiles the files of the networks that come with drivezoo by gcc for this machine, and by cross
compilers for 32-bit x86 and for ARM, whose program runs under qemu. It stops at a warning. A
compiler that is not installed leaves its column empty. Debian: apt install gcc-i686-linux-gnu
gcc-arm-linux-gnueabihf libc6-dev-i386-cross libc6-dev-armhf-cross qemu-user. (Its gcc-multilib, for
`gcc -m32`, cannot be installed together with cross compilers.)
"""

import subprocess
import time
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

import numpy as np
import torch

from benchmarks.measuring import markdown_table, write_between
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.command import Policy
from zoo.checkpoints.policy import CheckpointPolicy
from zoo.drives.metrics import measure
from zoo.export.c_file import c_header, c_source, rounded
from zoo.export.compiled_policy import CompiledPolicy
from zoo.models.make_network import multiply_adds
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

PAGE = Path("docs/onto_the_car.md")
NETWORKS = ("linear", "tiny41", "tiny63", "lenet", "pilotnet")
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror")
ARM = "arm-linux-gnueabihf-"
BUILDS = {
    "x86-64": (["gcc"], []),
    "32-bit x86": (["i686-linux-gnu-gcc", "-static"], []),
    "ARM": ([f"{ARM}gcc", "-static"], ["qemu-arm"]),
}
EMULATED = 300_000_000  # most multiply-adds under qemu, a hundred times slower: fewer frames
SMALL = ("-std=c99", "-Os", "-mthumb", "-c")  # for the size on a microcontroller
SEEDS = 1  # of one track, further ones show nothing new
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
HEAD = ["network", "weights", "code and constants, kB", "memory, kB", "multiply-adds", "ms"]
HEAD += [
    *(f"difference, {build}" for build in BUILDS),
    "laps without intervention",
    "mean cross-track error, m",
]


def measure_c_files(
    frames: list[np.ndarray], speeds: np.ndarray, networks: tuple[str, ...], write: bool
) -> None:
    """Print the table of the C files, and write it to the manual.

    Args:
        frames: frames on which the programs are compared with the checkpoint.
        speeds: speed at each frame, mph.
        networks: names of networks that come with drivezoo; empty for all.
        write: whether to write the table to the manual.
    """
    torch.set_num_threads(1)
    rows = []
    for name in networks or NETWORKS:
        rows += _rows(name, frames, speeds)
        print("\n".join(" | ".join(row) for row in rows[-3:]), flush=True)
    table = markdown_table(HEAD, rows, left=2)
    if write:
        write_between(PAGE, "c files", table)
    else:
        print(table)


def _rows(name: str, frames: list[np.ndarray], speeds: np.ndarray) -> list[list[str]]:
    """Return a row for the checkpoint and one for each type of weights."""
    checkpoint = load_checkpoint(name)
    height, width, channels = checkpoint.view.shape
    operations = multiply_adds(checkpoint.network, (channels, height, width))
    policy = CheckpointPolicy(checkpoint)
    wanted = np.array([policy(*pair).steering for pair in zip(frames, speeds, strict=True)])
    empty = ["-"] * len(BUILDS)
    own = [_ms(policy, frames), *empty, *_drives(policy)]
    rows = [[name, "checkpoint", "-", "-", f"{operations:,}", *own]]
    for weights in ("float", "int8"):
        with TemporaryDirectory() as place:
            folder = Path(place)
            source = folder / "steer.c"
            written = rounded(checkpoint) if weights == "int8" else checkpoint
            source.write_text(c_source(written, "steer", weights))
            source.with_suffix(".h").write_text(c_header(written, "steer", ""))
            compiled = CompiledPolicy(written, source)
            found = [_steering(folder, one, frames, speeds, operations) for one in BUILDS]
            differences = [
                "-" if one is None else f"{np.abs(one - wanted[: len(one)]).max():.1e}"
                for one in found
            ]
            row = [name, weights, *_kilobytes(folder), f"{operations:,}"]
            rows.append([*row, _ms(compiled, frames), *differences, *_drives(compiled)])
    return rows


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
    times = []
    for frame in frames[:100]:
        began = time.process_time()
        policy(frame, 9.0)
        times.append(1000 * (time.process_time() - began))
    return f"{np.median(times):.2f}"


def _drives(policy: Policy) -> list[str]:
    """Return the laps of the lake without an intervention, and the mean cross-track error."""
    drives = all_drives(policy, [Scenario("lake", seed=seed) for seed in range(SEEDS)])
    figures = [measure(drive) for drive in drives]
    kept = sum(one["interventions"] == 0 for one in figures)
    error = np.mean([one["cte_mean_m"] for one in figures])
    return [f"{kept} of {len(figures)}", f"{error:.3f}"]
