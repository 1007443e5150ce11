"""What a network sees of a frame: crop, colour, size and resize. No other code decides this."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np

from zoo.base.errors import InputError

FRAME = (160, 320)  # height and width of a frame where no recording tells; a crop counts its rows
# OpenCV's codes of colours with three channels: from RGB, and back.
CODES = {
    "bgr": (cv2.COLOR_RGB2BGR, cv2.COLOR_BGR2RGB),
    "yuv": (cv2.COLOR_RGB2YUV, cv2.COLOR_YUV2RGB),
    # Before 3.2, OpenCV's RGB2YUV exchanged red and blue (pull request 7481, October 2016).
    "yuv_old": (cv2.COLOR_BGR2YUV, cv2.COLOR_YUV2BGR),
    "hsv": (cv2.COLOR_RGB2HSV, cv2.COLOR_HSV2RGB),
}
CONVERSIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "rgb": lambda image: image,
    **{colour: partial(cv2.cvtColor, code=code) for colour, (code, _) in CODES.items()},
    "gray": lambda image: cv2.cvtColor(image, cv2.COLOR_RGB2GRAY),
    "hsv_s": lambda image: cv2.cvtColor(image, cv2.COLOR_RGB2HSV)[:, :, 1],
}
# By area, every pixel of the frame counts: thin lane lines do not flicker.
RESIZES = {
    "area": cv2.INTER_AREA,
    "linear": cv2.INTER_LINEAR,
    "area_first": cv2.INTER_AREA,
    "linear_first": cv2.INTER_LINEAR,
    "blur_linear": cv2.INTER_LINEAR,
}


@dataclass(frozen=True)
class View:
    """A function from a frame to a network's input, uint8 to uint8: crop, then colour, then size.

    A frame may have any size: the same shares of it are cropped, and it is resized at most once.

    Attributes:
        crop: rows removed from the top and the bottom, in 160ths of a frame's height.
        colour: `rgb`, `bgr`, `yuv`, `yuv_old` (YUV of OpenCV before 3.2), `hsv` (OpenCV's, hue
            0..179), `gray` or `hsv_s` (the saturation of HSV).
        size: `(height, width)` after resizing; None to keep the cropped size of `frame`.
        resize: `area`, or `linear` without smoothing; `area_first` and `linear_first` resize
            before the colour conversion; `blur_linear` blurs by 3 x 3 pixels before it.
        frame: `(height, width)` of the training's frames.
    """

    crop: tuple[int, int]
    colour: str
    size: tuple[int, int] | None
    resize: str = "area"
    frame: tuple[int, int] = FRAME

    def __post_init__(self) -> None:
        object.__setattr__(self, "crop", _pair("data.crop", self.crop, least=0))
        if sum(self.crop) >= FRAME[0]:
            raise InputError(
                f"data.crop={list(self.crop)} leaves nothing of {FRAME[0]} rows; crop less"
            )
        if self.colour not in list(CONVERSIONS):  # a list: the value may have no hash
            raise InputError(f"model.colour={self.colour} is not one of {', '.join(CONVERSIONS)}")
        if self.resize not in list(RESIZES):
            raise InputError(f"model.resize={self.resize} is not one of {', '.join(RESIZES)}")
        if self.size is not None:
            object.__setattr__(self, "size", _pair("model.size", self.size, least=1))
        object.__setattr__(self, "frame", _pair("frame", self.frame, least=1))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return the output's `(height, width, channels)`."""
        height, width = self.frame
        size = self.size or (height - sum(self.rows_cropped(height)), width)
        return (*size, 1 if self.colour in ("gray", "hsv_s") else 3)

    def rows_cropped(self, height: int) -> tuple[int, int]:
        """Return the rows to remove from the top and the bottom of a frame of this height.

        They are rounded down, which leaves a row of any frame.

        >>> View((60, 25), "rgb", None).rows_cropped(480)
        (180, 75)
        """
        top, bottom = self.crop
        return top * height // FRAME[0], bottom * height // FRAME[0]

    @property
    def crop_text(self) -> str:
        """Describe the rows that it removes from the training's frames."""
        height, width = self.frame
        top, bottom = self.rows_cropped(height)
        frame = f"a frame of {height} x {width} pixels"
        return f"{top} rows at the top and {bottom} at the bottom of {frame}"

    def __call__(self, frame: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return the view of a frame uint8 [H, W, 3] RGB, written to `out` if given.

        Raises:
            InputError: the frame has another shape or type.
        """
        frame = np.asarray(frame)
        if frame.ndim != 3 or frame.shape[2] != 3 or not frame.size or frame.dtype != np.uint8:
            raise InputError(
                f"frame: is {frame.dtype} {list(frame.shape)}; a network takes the camera's image, "
                "uint8 [height, width, 3] RGB: convert it"
            )
        top, bottom = self.rows_cropped(len(frame))
        image, convert = frame[top : len(frame) - bottom], CONVERSIONS[self.colour]
        if self.resize.endswith("_first"):
            image = convert(self._resized(image))
        else:
            image = self._resized(convert(image), out)
        image = image.reshape(self.shape)
        if out is None or np.shares_memory(image, out):
            return image
        out[:] = image
        return out

    def _resized(self, image: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        height, width, _ = self.shape
        if image.shape[:2] == (height, width):
            return image
        if self.resize == "blur_linear":
            image = cv2.GaussianBlur(image, (3, 3), 0)
        return cv2.resize(image, (width, height), dst=out, interpolation=RESIZES[self.resize])

    def to_dict(self) -> dict:
        """Return plain containers, for a checkpoint; `View.from_dict` reads them."""
        fields = asdict(self).items()
        return {key: list(value) if isinstance(value, tuple) else value for key, value in fields}

    @classmethod
    def from_dict(cls, plain: dict) -> "View":
        """Return the view that `to_dict` wrote."""
        return cls(**plain)


def view_to_rgb(image: np.ndarray, colour: str) -> np.ndarray:
    """Return a view's image, uint8 [H, W, C], as RGB [H, W, 3] to show."""
    if colour in CODES:
        return cv2.cvtColor(image, CODES[colour][1])
    return np.repeat(image, 3, axis=2) if image.shape[2] == 1 else image


def _pair(key: str, pair: Any, least: int) -> tuple[int, ...]:
    is_pair = isinstance(pair, Sequence) and len(pair) == 2
    if not is_pair or any(type(number) is not int or number < least for number in pair):
        what = "top,bottom" if key == "data.crop" else "height,width"
        raise InputError(f"{key}={pair} is not two whole numbers, {key}=[{what}], {least} or more")
    return tuple(pair)
