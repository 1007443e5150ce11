"""Options of `drivezoo import`."""

import re
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from zoo.base.errors import UsageError
from zoo.input_search.combinations import LEAST_ROWS
from zoo.keras.keras_model import THROTTLE_RANGE

Colour = Literal["rgb", "bgr", "yuv", "yuv_old", "hsv", "gray", "hsv_s"]
# An example of each pair, and the form of its numbers.
EXAMPLES = {
    "crop": ("[60,25]", r"\d{1,4}"),
    "size": ("[66,200]", r"\d{1,4}"),
    "scale": ("[127.5,1], the divisor first and not 0", r"-?\d{1,6}(\.\d{1,9})?"),
}
Resize = Literal["area", "linear", "area_first", "linear_first", "blur_linear"]


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Keys of `drivezoo import`.

    Args:
        recording: folder of a recording, best of the track it was trained on; finds out by trying
            what is not known of the input; null: guess it.
        colour: rgb, bgr, yuv, yuv_old (OpenCV before 3.2), hsv, gray or hsv_s; null: unknown.
        crop: [60,25]: rows cut off at the top and the bottom of 160; null: unknown.
        size: [66,200]: rows and columns of the network's input; null: read from the file.
        resize: area, linear, area_first or linear_first (before the colour), or blur_linear (3 x 3
            pixels); null: unknown.
        scale: [127.5,1]: the network computes pixel / 127.5 - 1; null: read from the file.
        lambdas: [WORD,...]: what each unclear Lambda computes, in order.
        outputs: [steering,ignored]: name of each output (steering, throttle, ignored), if there are
            several.
        throttle_range: MODEL_CATEGORICAL_MAX_THROTTLE_RANGE of a categorical network of Donkeycar.
        weights: .h5 file with the weights of a .json; null: the one in its folder.
        frames: number of frames to try each input on.
        drive: false: do not drive the inputs that are too near to tell apart on udacity_lake.
        out: checkpoint to write; null: FILE's name with .ckpt, in the current folder.
    """

    recording: str | None = None
    colour: Colour | None = None
    crop: str | None = None
    size: str | None = None
    resize: Resize | None = None
    scale: str | None = None
    lambdas: str | None = None
    outputs: str | None = None
    throttle_range: Annotated[float, Field(gt=0, le=1)] = THROTTLE_RANGE
    weights: str | None = None
    frames: Annotated[int, Field(ge=LEAST_ROWS, le=2000)] = 300
    drive: bool = True
    out: str | None = None

    def pair(self, key: str) -> tuple[float, float] | None:
        """Return `crop` or `size` as two whole numbers, or `scale` as divisor and subtracted one.

        Raises:
            UsageError: it is no such pair.
        """
        text = getattr(self, key)
        words = read_list(text)
        if words is None:
            return None
        example, number = EXAMPLES[key]
        if (
            len(words) != 2
            or not all(re.fullmatch(number, one) for one in words)
            or (key == "scale" and float(words[0]) == 0)
        ):
            raise UsageError(f"{key}={text}: must be two numbers, as in {key}={example}")
        one, other = map(float if key == "scale" else int, words)
        return one, other


def read_list(text: str | None) -> list[str] | None:
    """Return the words of a list, with or without brackets; None for None.

    >>> read_list("[60, 25]"), read_list("atan:2"), read_list("[]")
    (['60', '25'], ['atan:2'], [])
    """
    if text is None:
        return None
    inner = text.strip().removeprefix("[").removesuffix("]")
    return [one for one in (word.strip(" '\"") for word in inner.split(",")) if one]
