"""Measurements of recordings: `python benchmarks/recordings.py NAME ...`, one function each."""

import os
import random
import tempfile
import time
from collections.abc import Callable
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from benchmarks.material import pictures
from benchmarks.measuring import markdown_table, print_table, run_named
from datamodules.image import decode_image, read_image
from datamodules.recording import Recording, read_recordings
from datamodules.view import View

LABELS = ("steering", "throttle", "brake", "speed_mph", "time_s")
VIEW = View((40, 20), "rgb", (66, 200))


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


def storage(folder: str | None = None) -> None:
    """Measure the bytes of an image and how fast a core decodes it: `storage [RECORDING]`.

    An image is stored as recorded, or as the view of `nvidia`.
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

    kinds: dict[str, tuple[list, Callable]] = {
        "JPEG, as recorded": (recorded, lambda data: VIEW(decode_image(data.tobytes()))),
        "view, JPEG of quality 95": (encoded(".jpg", cv2.IMWRITE_JPEG_QUALITY, 95), decoded),
        "view, PNG": (encoded(".png"), decoded),
    }
    rows = []
    for name, (data, decode) in kinds.items():
        seconds = []
        for _ in range(5):
            began = time.process_time()
            for item in data:
                decode(item)
            seconds.append(time.process_time() - began)
        size = np.mean([item.nbytes for item in data])
        rows.append([name, f"{size:,.0f}", f"{len(data) / min(seconds):,.0f}"])
    print_table(["stored", "bytes", "images/s of a core, the best of five rounds"], rows)


if __name__ == "__main__":
    run_named(exchange, storage)
