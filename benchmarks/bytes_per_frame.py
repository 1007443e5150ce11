"""Measure the figures of `docs/scale.md`: `benchmarks/bytes_per_frame.py [RECORDING] [hours=N]`.

These are the bytes of an image as recorded and as a view, the speed at which one core decodes them,
and the storage of N hours of three cameras. Prices are the published ones of S3 in us-east-1, first
tier.
"""

import random
import sys
import time
from collections.abc import Callable
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from material import pictures
from rich.console import Console
from rich.table import Table

from datamodules.image import decode_image
from datamodules.view import View

ROWS_PER_S, CAMERAS, SHARD_BYTES = 15, 3, 128e6
GB_MONTH, GET, PUT = 0.023, 0.0004 / 1000, 0.005 / 1000  # US dollars
AIM = 200_000  # samples per second of a GPU
VIEW = View((40, 20), "rgb", (66, 200))


def main(arguments: list[str]) -> None:
    options = dict(one.split("=") for one in arguments if "=" in one)
    named = [Path(one) / "IMG" for one in arguments if "=" not in one]
    files = sorted(named[0].glob("*.jpg")) if named else [*chain(*pictures().values())]
    random.Random(0).shuffle(files)
    cv2.setNumThreads(1)
    recorded = [np.frombuffer(file.read_bytes(), np.uint8) for file in files[:600]]
    views = [VIEW(decode_image(data.tobytes())) for data in recorded]
    kinds: dict[str, tuple[list, Callable | None]] = {
        "JPEG, as recorded": (recorded, lambda data: VIEW(decode_image(data.tobytes()))),
        "view, JPEG of quality 95": (
            encoded(views, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, 95]),
            view_of,
        ),
        "view, PNG": (encoded(views, ".png", []), view_of),
        "view, uncompressed": (views, None),
    }
    count = float(options.get("hours", 10_000)) * 3600 * ROWS_PER_S * CAMERAS
    console = Console()
    console.print(f"{count:,.0f} images; a GPU that takes {AIM:,} samples/s; by kind of storage:")
    table = Table(
        "stored", "bytes", "total", "per month", "GETs of an epoch", "network of a GPU", "its cores"
    )
    for name, (data, decode) in kinds.items():
        size = float(np.mean([one.nbytes for one in data]))
        cores = "0" if decode is None else f"{AIM / rate(data, decode):,.0f}"
        table.add_row(
            name,
            f"{size:,.0f}",
            f"{size * count / 1e12:,.1f} TB",
            f"${size * count / 1e9 * GB_MONTH:,.0f}",
            f"${size * count / SHARD_BYTES * GET:,.2f}",
            f"{AIM * size * 8 / 1e9:,.0f} Gbit/s",
            cores,
        )
    console.print(table)
    size = float(np.mean([one.nbytes for one in recorded]))
    shards, seconds = size * count / SHARD_BYTES, SHARD_BYTES / size / CAMERAS / ROWS_PER_S
    console.print(
        f"a shard of {SHARD_BYTES / 1e6:.0f} MB as recorded: {SHARD_BYTES / size:,.0f} images, "
        f"{seconds:,.0f} s of driving; {shards:,.0f} shards, ${shards * PUT:,.2f} to upload\n"
        f"one object per image: ${count * PUT:,.0f} to upload, ${count * GET:,.0f} per epoch"
    )


def encoded(views: list[np.ndarray], kind: str, settings: list[int]) -> list[np.ndarray]:
    return [cv2.imencode(kind, one[:, :, ::-1], settings)[1] for one in views]


def view_of(data: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def rate(data: list[np.ndarray], decode: Callable) -> float:
    """Return the images per second of processor time on one core, the best of five rounds."""
    best = np.inf
    for _ in range(5):
        began = time.process_time()
        for one in data:
            decode(one)
        best = min(best, time.process_time() - began)
    return len(data) / best


if __name__ == "__main__":
    main(sys.argv[1:])
