"""A folder that what a test does must leave as it is."""

import contextlib
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def unchanged(folder: Path) -> Iterator[None]:
    """Check that the folder has the same files with the same times after the block."""

    def times() -> dict[Path, int]:
        return {path: path.stat().st_mtime_ns for path in [folder, *folder.rglob("*")]}

    before = times()
    yield
    assert times() == before
