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
    return _png(width, height, (1, 0), bytes((width // 8 + 1) * height))


def png_claim(width: int, height: int) -> bytes:
    """Return a PNG whose header claims a size, with almost no data."""
    return _png(width, height, (8, 2), bytes(100))


def _png(width: int, height: int, bits_and_colour: tuple[int, int], pixels: bytes) -> bytes:
    head = struct.pack(">IIBBBBB", width, height, *bits_and_colour, 0, 0, 0)
    chunks = {b"IHDR": head, b"IDAT": zlib.compress(pixels, 9), b"IEND": b""}
    parts = [b"\x89PNG\r\n\x1a\n"]
    for kind, data in chunks.items():
        check = struct.pack(">I", zlib.crc32(kind + data))
        parts.append(struct.pack(">I", len(data)) + kind + data + check)
    return b"".join(parts)
