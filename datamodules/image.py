"""Decode camera images, from files and shards; check, link and copy their files."""

import errno
import io
import os
import struct
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile

from zoo.base.bounded_files import HEAD_BYTES, find_kind, open_regular, read_regular

# Limits before an image is read and before it is decoded: a few kB can hold gigabytes of pixels.
MOST_IMAGE_BYTES = 32_000_000
MOST_PIXELS = 64_000_000
MOST_SCANS = 64  # of a JPEG, each a pass over all pixels; a progressive one has some 10
TAIL = 1024  # bytes at a file's end that must hold the end marker

# The first bytes of each kind of file, and its end marker. A JPEG's data never holds FF D9, so the
# marker stands only at the true end.
_KINDS = ((b"\xff\xd8\xff", b"\xff\xd9"), (b"\x89PNG\r\n\x1a\n", b"IEND"))
_FRAMES, _SCAN = (0xC0, 0xC1, 0xC2), 0xDA  # markers of frames and of a scan
_EXIF, _TURN, _QUARTERS = b"Exif", 0x0112, (5, 6, 7, 8)  # turns that swap width and height
NO_IMAGE = "the file is no JPEG or PNG"
# Errors after which a link is replaced by a copy: another file system, or one without links; a
# file of another user; too many links.
_NO_LINK = {errno.EXDEV, errno.EPERM, errno.EACCES, errno.EMLINK, errno.ENOTSUP, errno.ENOSYS}
_NO_LINK |= {errno.EINVAL}  # on Windows: a disk of exFAT, or too many links


Stored = np.ndarray | bytes  # pixels, uint8 [H, W, 3] RGB, or a JPEG or PNG


@dataclass(frozen=True, slots=True)
class StoredImage:
    """An image inside of a larger file, such as a video or a table.

    Attributes:
        file: path of the file.
        number: position in it; images of a file are read fastest in the order of their numbers.
        reader: function from file and number to pixels, uint8 [H, W, 3] RGB, or to the bytes of a
            JPEG or PNG; it raises ValueError for an image that it cannot read.
        column: name of the column, in a file that has several images at a position.
    """

    file: str
    number: int
    reader: Callable[[str, int], Stored]
    column: str = ""

    def __str__(self) -> str:
        return f"{self.file}#{self.number + 1}"


class ForwardReader:
    """A reader of files whose contents can only be read in order; one file is open at a time.

    Threads wait for each other: the page of `edit` shows, analyses and writes images at once.

    Args:
        contents: function from a file to its contents, in order.
    """

    def __init__(self, contents: Callable[[Path], Iterator[Stored]]) -> None:
        self._contents = contents
        self._file, self._next, self._lock = "", 0, threading.Lock()

    def __call__(self, file: str, number: int) -> Stored:
        """Return what stands at a position of a file; going back begins the file again.

        Raises:
            ValueError: the file is shorter.
        """
        with self._lock:
            if file != self._file or number < self._next - 1:
                self._file, self._next, self._items = file, 0, self._contents(Path(file))
            for item in self._items if number >= self._next else ():
                self._last, self._next = item, self._next + 1
                if self._next > number:
                    break
            if number >= self._next:
                raise ValueError(f"it has {self._next:,} images, and this is number {number + 1:,}")
            return self._last


AnyImage = str | Path | StoredImage


def read_stored(image: AnyImage) -> Stored:
    """Return an image as it is stored: bytes of a JPEG or PNG, or pixels of a video.

    Raises:
        OSError: the file cannot be read, is no regular one or too large.
        ValueError: a larger file has no such image.
    """
    if isinstance(image, StoredImage):
        return image.reader(image.file, image.number)
    return read_regular(image, MOST_IMAGE_BYTES)


def read_image(image: AnyImage) -> np.ndarray:
    """Return an image in its own size, uint8 [H, W, 3] RGB.

    Raises:
        OSError, ValueError: see `read_stored` and `decode_image`.
    """
    stored = read_stored(image)
    return decode_image(stored) if isinstance(stored, bytes) else stored


def encode_image(image: np.ndarray, suffix: str = ".jpg", quality: int = 95) -> bytes:
    """Return an image, uint8 [H, W, 3] RGB, as a PNG, or as a JPEG of this quality, 1..100."""
    bgr = np.ascontiguousarray(image[:, :, ::-1])
    if suffix.lower() == ".png":
        return cv2.imencode(".png", bgr)[1].tobytes()
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def reading_threads(images: Iterable[object], threads: int) -> int:
    """Return how many threads may read images: one, where some can only be read in order."""
    return 1 if any(isinstance(image, StoredImage) for image in images) else threads


def decode_image(data: bytes, flags: int = cv2.IMREAD_COLOR_RGB) -> np.ndarray:
    """Return the image in JPEG or PNG bytes in its own size, uint8 [H, W, 3] RGB.

    Args:
        data: contents of a file.
        flags: OpenCV's flags of other sizes and colours.

    Raises:
        ValueError: the bytes are no JPEG or PNG; or the image lacks its end, which OpenCV would
            fill with grey, or has more than `MOST_PIXELS` or `MOST_SCANS`.
    """
    checked_size(data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:  # a size that OpenCV refuses
        raise ValueError(error.err) from None
    if image is None:
        raise ValueError(NO_IMAGE)
    return image


def checked_size(data: bytes) -> tuple[int, int]:
    """Return the width and height in a whole JPEG's or PNG's header.

    Raises:
        ValueError: see `decode_image`.
    """
    if fault := find_fault(data):
        raise ValueError(fault)
    width, height = jpeg_size(data) or image_size(io.BytesIO(data))
    if fault := find_size_fault(width, height) or find_scan_fault(data):
        raise ValueError(fault)
    return width, height


def find_fault(data: bytes) -> str | None:
    """Return what is wrong with an image, by the bytes of `read_ends`, or None."""
    if not data:
        return "the file is empty"
    for start, end in _KINDS:
        if data.startswith(start):
            return None if end in data[-TAIL:] else "the image is truncated"
    kind = find_kind(data[:HEAD_BYTES])
    return f"{NO_IMAGE}: it {kind}" if kind else NO_IMAGE


def find_size_fault(width: int, height: int) -> str | None:
    """Return what is wrong with an image's size, or None."""
    if width * height <= MOST_PIXELS:
        return None
    return f"the image has {width} x {height} pixels, more than {MOST_PIXELS:,}; scale it down"


def find_scan_fault(data: bytes, most: int = MOST_SCANS) -> str | None:
    """Return what is wrong with the number of a JPEG's scans, or None."""
    # Coded data never holds an SOS marker's two bytes, so there are no more scans than this.
    scans = data.count(b"\xff\xda") if data.startswith(b"\xff\xd8") else 1
    if scans <= most:
        return None
    return f"the JPEG has {scans:,} scans, more than {most}; save it again without them"


def image_size(file: BinaryIO) -> tuple[int, int]:
    """Return the width and height in a JPEG's or PNG's header, after the turn that EXIF names.

    Raises:
        ValueError: the header is damaged.
    """
    head = file.read(HEAD_BYTES)
    file.seek(0)
    try:
        # Image.open would print a warning about a size that this module refuses itself.
        kind = PngImageFile if head.startswith(_KINDS[1][0]) else JpegImageFile
        image = kind(file)
    except Exception as error:  # damaged bytes can make Pillow raise anything
        raise ValueError(f"{NO_IMAGE} ({str(error) or type(error).__name__})") from None
    turn = None
    with suppress(Exception):  # a damaged EXIF can raise anything; OpenCV turns nothing then
        turn = image.getexif().get(_TURN) if "exif" in image.info else None
    return image.size[::-1] if turn in _QUARTERS else image.size


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Return a plain JPEG's width and height, ten times as fast as Pillow; None for other data.

    Plain is a JPEG without EXIF, which may turn it.

    It follows the segments (ITU-T T.81, annex B) to the one of the frame.
    """
    at, end = 2, len(data) - 9
    while data.startswith(b"\xff\xd8") and at < end and data[at] == 0xFF:
        kind = data[at + 1]
        if kind in _FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        # A marker without a length, a fill byte, a scan, or a frame that OpenCV does not decode.
        if kind < _FRAMES[0] or kind in (0xC3, _SCAN, 0xFF) or 0xD0 <= kind <= 0xD9:
            break
        if data[at + 4 : at + 8] == _EXIF:
            break
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def read_ends(path: str) -> bytes:
    """Return a file's first `HEAD_BYTES` and last `TAIL` bytes.

    Raises:
        OSError: the file cannot be read, is no regular one or too large.
    """
    descriptor, size = open_regular(path, MOST_IMAGE_BYTES)
    try:
        head = os.read(descriptor, HEAD_BYTES)
        os.lseek(descriptor, max(size - TAIL, 0), os.SEEK_SET)
        return head + os.read(descriptor, TAIL)
    finally:
        os.close(descriptor)


def find_file_fault(image: AnyImage | None) -> str | None:
    """Return what is wrong with an image by its first and last bytes, or None, as without an image.

    A log, or a link in its folder, may name any file. Only images may get into a new folder.
    """
    try:
        stored = read_ends(image) if isinstance(image, str) else image and read_stored(image)
        fault = find_fault(stored) if isinstance(stored, bytes) else None
    except (OSError, ValueError) as error:
        fault = getattr(error, "strerror", None) or str(error)
    return f"{getattr(image, 'file', image)}: {fault}" if fault else None


def link_or_copy(path: str, target: Path) -> None:
    """Link a file under another name, or copy it where the file system has no links.

    Raises:
        OSError: the file cannot be read, or the disk is full.
    """
    try:
        os.link(os.path.realpath(path), target)
    except OSError as error:
        if error.errno not in _NO_LINK:
            raise
        target.write_bytes(read_regular(path, MOST_IMAGE_BYTES))


class ImageStore(ABC):
    """A reader of the images in shards: large files that a training walks over.

    A format of such files has a subclass.

    Attributes:
        images: number of images of each shard, by name.
        bytes: size of each shard, by name.
        is_remote: whether shards are fetched from another machine.
        remedy: what to do about a damaged shard, for messages.
    """

    images: dict[str, int]
    bytes: dict[str, int]
    is_remote: bool
    remedy: str

    @abstractmethod
    def __call__(self, file: str, number: int) -> Stored:
        """Return the JPEG or PNG at a position of a shard.

        Raises:
            OSError, ValueError: the shard is missing or damaged.
            InputError: a server does not answer.
        """

    @abstractmethod
    def fetch_ahead(self, names: list[str]) -> None:
        """Fetch shards in a thread; a failure is reported by the reader that needs the shard."""


def shard_of(image: object) -> tuple[str, ImageStore] | None:
    """Return the place of an image's shard, and its store; None for an image elsewhere."""
    if isinstance(image, StoredImage) and isinstance(image.reader, ImageStore):
        return image.file, image.reader
    return None
