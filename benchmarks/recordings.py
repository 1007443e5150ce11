"""Measure the storage of images: `python benchmarks/recordings.py storage [RECORDING]`."""

import random
import time
from collections.abc import Callable
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from benchmarks.material import pictures
from benchmarks.measuring import print_table, run_named
from datamodules.image import decode_image
from datamodules.view import View

VIEW = View((40, 20), "rgb", (66, 200))


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
    run_named(storage)
