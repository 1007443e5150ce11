"""Decode a camera picture; the one decoder for training and driving."""

import cv2
import numpy as np

FRAME_HEIGHT, FRAME_WIDTH = 160, 320  # what the original simulator records and sends

TAIL = 1024  # bytes of a file in which its end is looked for

_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_PNG_START, _PNG_END = b"\x89P", b"IEND"


def decode_image(data: bytes) -> np.ndarray:
    """The picture in JPEG or PNG bytes, uint8 [160, 320, 3] RGB; another size is resized to that.

    Raises:
        ValueError: the bytes are no picture, or a JPEG without its end, which OpenCV would fill
            with grey.
    """
    if not data:
        raise ValueError("the file is empty")
    if ends_early(data[:2], data[-TAIL:]):
        raise ValueError("the image is truncated")
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    if picture is None:
        raise ValueError("the file is no JPEG or PNG")
    if picture.shape[:2] != (FRAME_HEIGHT, FRAME_WIDTH):
        picture = cv2.resize(picture, (FRAME_WIDTH, FRAME_HEIGHT), interpolation=cv2.INTER_AREA)
    return picture


def ends_early(head: bytes, tail: bytes) -> bool:
    """Whether the first two and the last `TAIL` bytes are of a JPEG or PNG that was cut off."""
    # Within a JPEG's data FF is never followed by D9: the marker stands only at the true end.
    for start, end in ((_JPEG_START, _JPEG_END), (_PNG_START, _PNG_END)):
        if head == start:
            return end not in tail
    return False
