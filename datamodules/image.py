"""Decode a camera picture; the one decoder for training and driving."""

import cv2
import numpy as np

FRAME_HEIGHT, FRAME_WIDTH = 160, 320  # what the original simulator records and sends

_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"


def decode_image(data: bytes) -> np.ndarray:
    """The picture in JPEG or PNG bytes, uint8 [160, 320, 3] RGB; another size is resized to that.

    Raises:
        ValueError: the bytes are no picture, or a JPEG without its end, which OpenCV would fill
            with grey.
    """
    if not data:
        raise ValueError("the file is empty")
    # Within a JPEG's data FF is never followed by D9: the marker stands only at the true end.
    if data.startswith(_JPEG_START) and _JPEG_END not in data[-1024:]:
        raise ValueError("the JPEG is truncated")
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    if picture is None:
        raise ValueError("the file is no JPEG or PNG")
    if picture.shape[:2] != (FRAME_HEIGHT, FRAME_WIDTH):
        picture = cv2.resize(picture, (FRAME_WIDTH, FRAME_HEIGHT), interpolation=cv2.INTER_AREA)
    return picture
