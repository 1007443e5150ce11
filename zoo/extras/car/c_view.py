"""The view of a checkpoint as parts and tables of a C file, equal to OpenCV's to the bit.

OpenCV resizes uint8 images by area with sums of float, in the order of the image's memory, and
bilinearly with weights of 11 binary places (modules/imgproc/src/resize.cpp).
"""

import math
from collections.abc import Sequence

import numpy as np

from datamodules.view import View
from zoo.extras.car.c_source import CSource

ONE = 2048  # OpenCV's weight of a whole pixel
PARTS = {"rgb": "plain", "bgr": "plain", "yuv_old": "yuv", "hsv_s": "hsv"}
SWAPPED = ("bgr", "yuv_old")  # red and blue exchanged


def write_view(view: View, out: CSource) -> None:
    """Add the function `view` to a file, with its constants and tables."""
    height, width = view.frame
    top, bottom = view.rows_cropped(height)
    cropped = height - top - bottom
    rows, columns, channels = view.shape
    first = view.resize.endswith("_first")
    swapped = view.colour in SWAPPED
    out.constants |= {
        "FRAME_WIDTH": width,
        "TOP": top,
        "VIEW_HEIGHT": rows,
        "VIEW_WIDTH": columns,
        "CHANNELS": channels,
        "SAMPLED": 3 if first else channels,
        "RED": 2 * swapped,
        "GREEN": 1,
        "BLUE": 2 * (not swapped),
    }
    out.need(f"convert {PARTS.get(view.colour, view.colour)}")
    same = (cropped, width) == (rows, columns)
    if view.resize == "blur_linear" and not same:
        out.constants["CROPPED_HEIGHT"] = cropped
        out.need("sample blurred")
    else:
        out.need("sample raw" if first else "sample converted")
    out.need("store converted" if first else "store plain")
    scales = cropped / rows, width / columns
    whole = all(scale == int(scale) for scale in scales)
    by_area = view.resize.startswith("area")
    if same:
        out.need("view same")
        return
    averages = (by_area and min(scales) >= 1) or scales == (2, 2)
    out.need("view area" if averages else "view linear")
    if averages:
        out.constants["HALF_UP"] = int(scales == (2, 2))
        # Of whole pixels, OpenCV adds whole numbers and divides at the end.
        out.definitions["AREA_SCALE"] = 1 / math.prod(scales) if whole else 1.0
    for axis, size, count in (("row", cropped, rows), ("column", width, columns)):
        if averages:
            starts, places, weights = _area_taps(size, count, whole)
            out.table(f"{axis}_start", "uint16_t", starts)
        else:
            places, weights = _linear_taps(size, count, by_area, axis == "row")
        out.table(f"{axis}_at", "uint16_t", places)
        out.table(f"{axis}_weight", "float" if averages else "int16_t", weights)


def _area_taps(size: int, count: int, whole: bool) -> tuple[list[int], list[int], Sequence[float]]:
    """Return starts, pixels and weights of `count` pixels of `size`, as in OpenCV's table."""
    scale = 1 / (count / size)
    starts, places, weights = [0], [], []
    for number in range(count):
        begin = number * scale
        end = begin + scale
        cell = min(scale, size - begin)
        last = min(math.floor(end), size - 1)
        low = min(math.ceil(begin), last)
        if whole:
            low, last, cell = number * round(scale), (number + 1) * round(scale), 1
        taps = [(pixel, 1 / cell) for pixel in range(low, last)]
        if low - begin > 1e-3 and not whole:
            taps.insert(0, (low - 1, (low - begin) / cell))
        if end - last > 1e-3 and not whole:
            taps.append((last, min(end - last, 1, cell) / cell))
        places += [pixel for pixel, _ in taps]
        weights += [weight for _, weight in taps]
        starts.append(len(places))
    return starts, places, weights


def _linear_taps(size: int, count: int, by_area: bool, is_row: bool) -> tuple[list[int], list[int]]:
    """Return two places and weights of each of `count` pixels; by area where it enlarges."""
    inverse = count / size
    scale = 1 / inverse
    places, weights = [], []
    for number in range(count):
        if by_area:
            low = math.floor(number * scale)
            share = np.float32((number + 1) - (low + 1) * inverse)
            share = np.float32(0) if share <= 0 else share - np.floor(share)
        else:
            share = np.float32((number + 0.5) * scale - 0.5)
            low = math.floor(share)
            share = share - np.float32(low)
        if not is_row and not 0 <= low < size - 1:
            share = np.float32(0)
        places += [min(max(pixel, 0), size - 1) for pixel in (low, low + 1)]
        weights += [round(float(weight * ONE)) for weight in (np.float32(1) - share, share)]
    return places, weights
