"""Shards: files of thousands of images, in a folder or at an S3 address, through a bounded cache.

They have LitData's format, and `index.json` names them. LitData can store items as pickles, which
run code when they are read, and its reader keeps one shard open at a time. So shards are read here,
by an image's two offsets, and only items that are plain bytes.
"""

import functools
import hashlib
import itertools
import os
import re
import struct
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from filelock import FileLock

from datamodules.image import MOST_IMAGE_BYTES, ImageStore
from datamodules.recording import file_name
from zoo.base.errors import InputError, optional_import
from zoo.base.limits import is_ordinary
from zoo.base.plain_files import read_json

SCHEME = "s3:"
INDEX = "index.json"
EXTRA = 'pip install "drivezoo[shards]"'
REMEDY = "copy it again, or write the shards again: drivezoo convert FOLDER to=shards out=NEW"
# Seconds between attempts to reach a server: two minutes, in which a server restarts.
WAITS_S = (1, 2, 4, 8, 15, 30, 30, 30)
ITEMS = {"data_format": ["bytes"], "compression": None, "encryption": None}
_NAME = re.compile(r"chunk-\d{1,9}-\d{1,9}\.bin")


def is_address(path: Path) -> bool:
    """Return whether a path is the address of a folder in an S3-compatible store.

    >>> is_address(Path("s3://bucket/drives")), is_address(Path("drives"))
    (True, False)
    """
    return path.parts[:1] == (SCHEME,)


class ShardStore(ImageStore):
    """The shards of a folder or an address; a call reads an image.

    Args:
        path: folder of shards, or address, `s3://BUCKET/FOLDER`.
        cache: folder of fetched shards; None for a local folder.
        cache_bytes: most bytes of all fetched shards in that folder.

    Raises:
        InputError: the index or a shard is missing or damaged, or the server does not answer.
    """

    remedy = REMEDY

    def __init__(self, path: Path, cache: Path | None, cache_bytes: int) -> None:
        self.source, self.folder, self.cache_bytes = str(path), path, cache_bytes
        self.is_remote = is_address(path)
        if self.is_remote:
            self.source = f"s3://{'/'.join(path.parts[1:])}"
            if cache is None:
                raise InputError(f"{self.source}: shards need a cache; set data.cache=FOLDER")
            self.cache = cache / "shards"
            self.cache.mkdir(parents=True, exist_ok=True)
            with self._locked():
                index = self.cache / INDEX
                self._download(INDEX, index)
                key = hashlib.sha256(self.source.encode() + index.read_bytes()).hexdigest()[:16]
                self.folder = self.cache / key
                self.folder.mkdir(exist_ok=True)
                shards = self._read_index(index)
                self._make_room(0)  # an earlier command may have had a larger cache
        else:
            shards = self._read_index(path / INDEX)
        self.bytes = {name: int(size) for name, (size, _) in shards.items()}
        self.images = {name: int(count) for name, (_, count) in shards.items()}
        for name in () if self.is_remote else self.bytes:
            self._check_size(name, path / name)

    def __call__(self, file: str, number: int) -> bytes:
        """Return the image at a position of a shard; see `ImageStore`."""
        with self._open(file_name(file)) as shard:
            shard.seek(4 + 4 * number)  # after the number of images
            head = shard.read(8)
            begin, end = struct.unpack("<II", head) if len(head) == 8 else (0, 0)
            shard.seek(begin + 4)  # after the image's own number of bytes
            data = shard.read(max(0, min(end - begin - 4, MOST_IMAGE_BYTES)))
        if not data or len(data) < end - begin - 4:
            raise ValueError("the shard is damaged")
        return data

    def fetch(self, name: str) -> Path:
        """Return a file of the store on this disk; only shards are not fetched again.

        One file is fetched at a time, in several connections. The files used longest ago make room.

        Raises:
            InputError: the server does not answer, or its file is missing or cut short.
        """
        path = self.folder / name
        if not self.is_remote:
            return path
        is_shard = name in self.bytes  # the key knows their sizes; labels may be corrected
        with suppress(OSError):
            os.utime(path)
            if is_shard:
                return path
        with self._locked():
            if not (is_shard and path.exists()):
                self._make_room(self.bytes.get(name, 0))
                part = self.folder / f".{name}.part"
                self._download(name, part)
                self._check_size(name, part)
                try:
                    part.replace(path)
                except PermissionError:  # Windows: another process reads it now
                    if not path.exists():
                        raise
        return path

    def fetch_ahead(self, names: list[str]) -> None:
        """Fetch shards in a thread; a failure is reported by the reader that needs the shard."""

        def fetch_all() -> None:
            with suppress(InputError, OSError):
                for name in names:
                    self.fetch(name)

        if self.is_remote:
            threading.Thread(target=fetch_all, daemon=True).start()

    def _open(self, name: str) -> Any:
        while True:
            path = self.fetch(name)
            try:
                return path.open("rb", buffering=0)
            except FileNotFoundError:  # another process made room
                if not self.is_remote:
                    raise

    def _locked(self) -> FileLock:
        """Return the lock of all fetched shards; the system releases it when a process dies."""
        return FileLock(self.cache / ".lock")

    def _make_room(self, size: int) -> None:
        for left in self.cache.glob("*/.*.part*"):
            left.unlink(missing_ok=True)  # of a killed process: we hold the lock
        shards = [(path.stat(), path) for path in self.cache.glob("*/*.bin")]
        used = sum(status.st_size for status, _ in shards)
        for status, shard in sorted(shards, key=lambda pair: pair[0].st_mtime_ns):
            if used + size <= self.cache_bytes:
                break
            with suppress(PermissionError):  # Windows keeps a file that is being read
                shard.unlink()
                used -= status.st_size

    def _download(self, name: str, target: Path) -> None:
        """Fetch a file; wait and try again while the server does not answer."""
        bucket, _, prefix = self.source.removeprefix("s3://").partition("/")
        client = _client(os.getpid())
        from boto3.exceptions import Boto3Error
        from botocore.exceptions import BotoCoreError, ClientError, NoCredentialsError
        from urllib3.exceptions import HTTPError

        for wait_s in (*WAITS_S, None):
            try:
                return client.download_file(bucket, f"{prefix}/{name}".lstrip("/"), str(target))
            except (BotoCoreError, Boto3Error, HTTPError, ClientError) as error:
                answer = getattr(error, "response", {}).get("ResponseMetadata", {})
                status = answer.get("HTTPStatusCode", 500)
                # Not the message itself, which may hold an address with a password.
                reason = f"HTTP {status}" if answer else type(error).__name__
            except OSError as error:
                raise InputError(
                    f"{target.parent}: cannot write the shards' cache ({error.strerror}); set "
                    "data.cache=FOLDER on another disk, or a smaller data.cache_gb"
                ) from None
            if status < 429 or reason == NoCredentialsError.__name__:
                raise InputError(
                    f"{self.source}/{name}: {reason}; check the address, AWS_ENDPOINT_URL and your "
                    "credentials (aws configure), or upload the shards again"
                )
            if wait_s is None:
                break
            line = f"{self.source}/{name}: {reason}; trying again in {wait_s} s"
            print(line, file=sys.stderr, flush=True)
            time.sleep(wait_s)
        raise InputError(
            f"{self.source}/{name}: no answer in {sum(WAITS_S)} s ({reason}); start the server, or "
            "correct AWS_ENDPOINT_URL, and start the command again"
        )

    def _check_size(self, name: str, path: Path) -> None:
        size = path.stat().st_size if path.exists() else 0
        if name in self.bytes and size != self.bytes[name]:
            raise InputError(
                f"{self.source}/{name}: has {size:,} bytes, and {self.bytes[name]:,} in {INDEX}; "
                f"{REMEDY}"
            )

    def _read_index(self, path: Path) -> dict[str, tuple[int, int]]:
        """Return each shard's number of bytes and of images."""
        index: Any = read_json(path)
        try:
            shards = {
                row["filename"]: (row["chunk_bytes"], row["chunk_size"]) for row in index["chunks"]
            }
            is_known = all(index["config"][key] == value for key, value in ITEMS.items())
            is_known &= all(map(_NAME.fullmatch, shards)) and len(shards) == len(index["chunks"])
        except (KeyError, TypeError):
            is_known, shards = False, {}
        numbers = itertools.chain(*shards.values())
        if not (is_known and shards and all(is_ordinary(number, 1, 2**32) for number in numbers)):
            raise InputError(f"{self.source}/{INDEX}: is no index of shards of images; {REMEDY}")
        return shards


@functools.lru_cache(maxsize=1)
def _client(process: int) -> Any:
    """Return boto3's client of a process, which a child must not share."""
    with optional_import(f"{SCHEME}//: an address of shards needs boto3; {EXTRA}"):
        import boto3
        from botocore.config import Config
    retries = {"total_max_attempts": 1}  # `ShardStore` tries again itself, and prints it
    return boto3.client("s3", config=Config(retries=retries, connect_timeout=5, read_timeout=30))
