"""Files that a stranger could craft: pickles, marshalled code and archives, byte by byte."""

import base64
import copy
import io
import marshal
import struct
import zipfile
from pathlib import Path

import torch


def contents_of(path: Path) -> dict:
    """Return a checkpoint's contents, for a change."""
    return copy.deepcopy(torch.load(path, weights_only=True))


def shared_lists(levels: int) -> list:
    """Return a list of two lists that are the same one, and so on: 2**levels values."""
    lists: list = [1]
    for _ in range(levels):
        lists = [lists, lists]
    return lists


def with_pickle(path: Path, pickle: bytes) -> Path:
    """Replace the pickle of a torch file, and return its path."""
    return rezip(path, {"data.pkl": pickle})


def rezip(path: Path, members: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    """Write an archive again, with other contents for members whose names end in the keys."""
    written = io.BytesIO()
    with zipfile.ZipFile(path) as before, zipfile.ZipFile(written, "w", compression) as after:
        for name in before.namelist():
            contents = [data for end, data in members.items() if name.endswith(end)]
            after.writestr(name, contents[0] if contents else before.read(name))
    path.write_bytes(written.getvalue())
    return path


def deep_pickle(levels: int) -> bytes:
    """Return a pickle of nested lists."""
    return b"\x80\x02" + b"]" * levels + b"a" * (levels - 1) + b"."


def many_lists(count: int) -> bytes:
    """Return a pickle of many empty lists, a byte each."""
    return b"\x80\x02](" + b"]" * count + b"e."


def shared_tuples_as_key(levels: int) -> bytes:
    """Return a pickle of a dict whose key has 2**levels values, which its hash would visit."""
    steps = b"".join(b"h%ch%c\x86q%c0" % (level, level, level + 1) for level in range(levels))
    return b"\x80\x02K\x01\x85q\x000" + steps + b"}h" + bytes([levels]) + b"K\x01s."


def calls_bytearray(size: int) -> bytes:
    """Return a pickle that makes torch allocate `size` bytes."""
    return b"\x80\x02c__builtin__\nbytearray\n\x8a\x08" + struct.pack("<q", size) + b"\x85R."


def lambda_with(constant: bytes) -> dict:
    """Return the config of a Keras Lambda that computes x * C, with C as it is marshalled."""
    number = 123.456789
    data = marshal.dumps((lambda x: x * 123.456789).__code__, 2)  # 2: floats as eight bytes
    before, separator, after = data.partition(b"g" + struct.pack("<d", number))
    assert separator
    code = base64.b64encode(before + constant + after).decode()
    return {"function": [code, None, None], "function_type": "lambda"}


def shared_constants(levels: int) -> bytes:
    """Return a marshalled tuple of tuples that refer to each other: 2**levels values."""
    data = b"(" + struct.pack("<i", levels + 1) + b"\xa9\x01i\x01\x00\x00\x00"
    for number in range(levels):
        data += b"\xa9\x02" + 2 * (b"r" + struct.pack("<i", number))
    return data
