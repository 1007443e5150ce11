"""Progressive JPEGs with a given number of scans."""

import io

from PIL import Image

SCANS = 10  # of a progressive JPEG as Pillow writes it


def many_scans(scans: int, size: int = 320) -> bytes:
    """Return a red JPEG whose last scan is repeated, which costs a pass over all pixels each."""
    buffer = io.BytesIO()
    Image.new("RGB", (size, size), (204, 0, 0)).save(buffer, "JPEG", progressive=True)
    plain = buffer.getvalue()
    last = plain[plain.rindex(b"\xff\xda") : -2]
    return plain[:-2] + last * (scans - SCANS) + plain[-2:]
