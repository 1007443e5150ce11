"""Small images that take long to decode."""

import io
import struct
import zlib

from PIL import Image

SCANS = 10  # of a progressive JPEG as Pillow writes it


def many_scans(scans: int, size: int = 320) -> bytes:
    """Return a red JPEG whose last scan is repeated, which costs a pass over all pixels each."""
    buffer = io.BytesIO()
    Image.new("RGB", (size, size), (204, 0, 0)).save(buffer, "JPEG", progressive=True)
    plain = buffer.getvalue()
    last = plain[plain.rindex(b"\xff\xda") : -2]
    return plain[:-2] + last * (scans - SCANS) + plain[-2:]


def png_bomb(width: int, height: int) -> bytes:
    """Return a PNG of one colour, far smaller than its pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    pixels = zlib.compress(bytes((width // 8 + 1) * height), 9)
    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks
