"""`python benchmarks/exchange.py FOLDER...`: what a recording is after an exchange, and its costs.

Converts the recording to LeRobot and to Donkeycar and back, in a temporary folder, and prints as
Markdown whether the log is equal to the bit, how far the images differ, sizes and processor time
(of the command and its ffmpeg).
"""

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from datamodules.formats.lerobot_export import export_lerobot
from datamodules.formats.recording_writer import convert_to_recording
from datamodules.formats.tub_export import export_tub
from datamodules.image import read_image
from datamodules.recording import Recording, read_recordings

LABELS = ("steering", "throttle", "brake", "speed_mph", "time_s")
EVERY = 10  # rows from one compared row to the next


def main(folders: list[str]) -> None:
    """Print a table with a row for each format."""
    if not folders:
        sys.exit("usage: python benchmarks/exchange.py FOLDER...")
    recording = read_recordings(folders)
    print(
        "| to | log equal | mean difference, of 255 | worst image | PSNR, dB | worst image |",
        end="",
    )
    print(" size, MB | out, s | back, s |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as temporary:
        for name, there, back in (
            ("LeRobot", export_lerobot, convert_to_recording),
            ("Donkeycar", export_tub, convert_to_recording),
        ):
            out, again = Path(temporary) / name, Path(temporary) / f"{name}_again"
            seconds = [
                processor_s(lambda there=there, out=out: there(recording, out)),
                processor_s(lambda back=back, out=out, again=again: back(out, again)),
            ]
            row = compared(recording, read_recordings(str(again)))
            size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6
            cells = [name, *row, f"{size:.0f}", *(f"{one:.0f}" for one in seconds)]
            print(f"| {' | '.join(cells)} |", flush=True)


def compared(before: Recording, after: Recording) -> list[str]:
    """Return the cells of a comparison: labels, then every tenth row's images."""
    equal = all(np.array_equal(getattr(before, one), getattr(after, one)) for one in LABELS)
    differences, squares = [], []
    for old, new in zip(before.images[::EVERY].flat, after.images[::EVERY].flat, strict=True):
        if new is not None:
            difference = read_image(new).astype(float) - read_image(old)
            differences.append(np.abs(difference).mean())
            squares.append(np.square(difference).mean())
    psnr = [
        f"{10 * np.log10(255**2 / one):.1f}" if one else "equal"
        for one in (np.mean(squares), np.max(squares))
    ]
    far = [f"{np.mean(differences):.2f}", f"{np.max(differences):.2f}"]
    return ["yes" if equal else "no", *far, *psnr]


def processor_s(work: Callable[[], object]) -> float:
    """Return the processor time of a function and of the processes that it started and awaited."""
    before = os.times()
    work()
    after = os.times()
    return sum(after[:4]) - sum(before[:4])


if __name__ == "__main__":
    main(sys.argv[1:])
