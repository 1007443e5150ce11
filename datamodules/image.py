"""Decode a camera picture; the one decoder for training and driving."""

import cv2
import numpy as np

FRAME_HEIGHT, FRAME_WIDTH = 160, 320  # what the original simulator records and sends

TAIL = 1024  # bytes of a file in which its end is looked for

# What a file begins with, and what stands near its end. Within a JPEG's data FF is never followed
# by D9: the marker stands only at the true end.
_KINDS = ((b"\xff\xd8\xff", b"\xff\xd9"), (b"\x89PNG\r\n\x1a\n", b"IEND"))
HEAD = 8  # bytes of a file that tell its kind
NO_IMAGE = "the file is no JPEG or PNG"


def decode_image(data: bytes) -> np.ndarray:
    """The picture in JPEG or PNG bytes, uint8 [160, 320, 3] RGB; another size is resized to that.

    Raises:
        ValueError: the bytes are no JPEG or PNG, or one without its end, which OpenCV would fill
            with grey.
    """
    if fault := find_fault(data[:HEAD], data[-TAIL:]):
        raise ValueError(fault)
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    except cv2.error as error:  # a size that OpenCV refuses
        raise ValueError(error.err) from None
    if picture is None:
        raise ValueError(NO_IMAGE)
    if picture.shape[:2] != (FRAME_HEIGHT, FRAME_WIDTH):
        picture = cv2.resize(picture, (FRAME_WIDTH, FRAME_HEIGHT), interpolation=cv2.INTER_AREA)
    return picture


def find_fault(head: bytes, tail: bytes) -> str | None:
    """Return what is wrong with an image by its first `HEAD` and last `TAIL` bytes, or None."""
    if not head:
        return "the file is empty"
    for start, end in _KINDS:
        if head.startswith(start):
            return None if end in tail else "the image is truncated"
    return NO_IMAGE
