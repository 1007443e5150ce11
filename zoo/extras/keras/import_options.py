"""Options of `drivezoo import`."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from zoo.extras.keras.combinations import LEAST_ROWS
from zoo.extras.keras.keras_model import THROTTLE_RANGE

Colour = Literal["rgb", "bgr", "yuv", "yuv_old", "hsv", "gray", "hsv_s"]
Resize = Literal["area", "linear", "area_first", "linear_first", "blur_linear"]
Pixels = Annotated[int, Field(ge=0, le=9999)]
Number = Annotated[float, Field(ge=-1e6, le=1e6)]


def _begins(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0]:
        raise ValueError("the first number is 0")
    return pair


Crop = Annotated[tuple[Pixels, Pixels], Field(examples=[(60, 25)])]
Size = Annotated[tuple[Pixels, Pixels], Field(examples=[(66, 200)])]
Numbers = Annotated[tuple[Number, Number], AfterValidator(_begins)]
Line = Annotated[Numbers, Field(examples=["[2.4,-1.2], the factor first and not 0"])]
DividedScale = Annotated[Numbers, Field(examples=["[127.5,1], the divisor first and not 0"])]


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
        steering: [2.4,-1.2]: the car's steering is 2.4 x output - 1.2; null: the output.
        throttle_range: MODEL_CATEGORICAL_MAX_THROTTLE_RANGE of a categorical network of Donkeycar.
        weights: .h5 file with the weights of a .json; null: the one in its folder.
        frames: largest number of frames to try an input on.
        drive: false: do not drive the best inputs on udacity_lake.
        out: checkpoint to write; null: FILE's name with .ckpt, in the current folder.
    """

    recording: str | None = None
    colour: Colour | None = None
    crop: Crop | None = None
    size: Size | None = None
    resize: Resize | None = None
    scale: DividedScale | None = None
    lambdas: list[str] | None = None
    outputs: list[str] | None = None
    steering: Line | None = None
    throttle_range: Annotated[float, Field(gt=0, le=1)] = THROTTLE_RANGE
    weights: str | None = None
    frames: Annotated[int, Field(ge=LEAST_ROWS, le=2000)] = 300
    drive: bool = True
    out: str | None = None
