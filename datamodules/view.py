"""What a network sees of a frame: crop, colour and size. No other code decides this."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from datamodules.errors import InputError
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH

CONVERSIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "rgb": lambda image: image,
    "yuv": lambda image: cv2.cvtColor(image, cv2.COLOR_RGB2YUV),
    "gray": lambda image: cv2.cvtColor(image, cv2.COLOR_RGB2GRAY),
    "hsv_s": lambda image: cv2.cvtColor(image, cv2.COLOR_RGB2HSV)[:, :, 1],
}


@dataclass(frozen=True)
class View:
    """A function from a frame to a network's input, uint8 to uint8: crop, then colour, then size.

    Attributes:
        crop: rows removed from the top and the bottom of the 160.
        colour: `rgb`, `yuv`, `gray` or `hsv_s` (the saturation of HSV).
        size: `(height, width)` after resizing by area; None to keep the cropped size.
    """

    crop: tuple[int, int]
    colour: str
    size: tuple[int, int] | None

    def __post_init__(self) -> None:
        _check_pair("data.crop", self.crop, least=0)
        if sum(self.crop) >= FRAME_HEIGHT:
            raise InputError(
                f"data.crop={list(self.crop)} leaves nothing of {FRAME_HEIGHT} rows; crop less"
            )
        if self.colour not in CONVERSIONS:
            raise InputError(f"model.colour={self.colour} is not one of {', '.join(CONVERSIONS)}")
        object.__setattr__(self, "crop", tuple(self.crop))
        if self.size is not None:
            _check_pair("model.size", self.size, least=1)
            object.__setattr__(self, "size", tuple(self.size))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return the output's `(height, width, channels)`."""
        size = self.size or (FRAME_HEIGHT - sum(self.crop), FRAME_WIDTH)
        return (*size, 3 if self.colour in ("rgb", "yuv") else 1)

    def __call__(self, frame: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Return the view of a frame uint8 [160, 320, 3] RGB, written to `out` if given."""
        top, bottom = self.crop
        image = CONVERSIONS[self.colour](frame[top : FRAME_HEIGHT - bottom])
        if self.size is not None:
            # By area, every pixel of the frame counts: thin lane lines do not flicker.
            height, width = self.size
            image = cv2.resize(image, (width, height), dst=out, interpolation=cv2.INTER_AREA)
        image = image.reshape(self.shape)
        if out is None:
            return image
        if not np.shares_memory(image, out):
            out[:] = image
        return out

    def to_dict(self) -> dict:
        """Return plain containers, for a checkpoint; `View.from_dict` reads them."""
        plain = asdict(self)
        return plain | {"crop": list(self.crop), "size": list(self.size) if self.size else None}

    @classmethod
    def from_dict(cls, plain: dict) -> "View":
        """Return the view that `to_dict` wrote."""
        return cls(**plain)


def view_to_rgb(image: np.ndarray, colour: str) -> np.ndarray:
    """Return a view's image, uint8 [H, W, C], as RGB [H, W, 3] to show."""
    if colour == "yuv":
        return cv2.cvtColor(image, cv2.COLOR_YUV2RGB)
    if image.shape[2] == 1:
        return np.repeat(image, 3, axis=2)
    return image


def _check_pair(key: str, pair: Any, least: int) -> None:
    is_pair = isinstance(pair, list | tuple) and len(pair) == 2
    if not is_pair or any(type(number) is not int or number < least for number in pair):
        what = "top,bottom" if key == "data.crop" else "height,width"
        raise InputError(f"{key}={pair} is not two whole numbers, {key}=[{what}], {least} or more")
