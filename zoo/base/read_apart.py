"""A stranger's file read by a process of its own, within a time and a memory for its size.

Libraries in C crash on some damaged files, and never return from others or take all memory. Then
Ctrl-C does not reach Python either.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from zoo.base.errors import InputError
from zoo.base.process_pool import LOOK_S, KilledProcessError, ProcessPool

# Limits for a small file, and for each byte of a larger one.
READ_S, BYTES_PER_S = 30.0, 10e6
FREE_BYTES, COPIES = 1_000_000_000, 4

Result = TypeVar("Result")


def read_apart(read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
    """Return `read(path, *arguments)`, a function at the top level of a module.

    Raises:
        InputError: as `read`; or the process crashed, or took too long or too much memory.
    """
    size = path.stat().st_size if path.is_file() else 0
    most_s, most_bytes = READ_S + size / BYTES_PER_S, FREE_BYTES + COPIES * size
    too_large = f"takes more than {most_bytes / 1e6:,.0f} MB"
    reason, last_s = f"does not end within {most_s:.0f} s", time.monotonic() + most_s
    with ProcessPool(1) as pool:
        pool.submit(_read, read, path, arguments, most_bytes)
        try:
            while time.monotonic() < last_s:
                for _, result in pool.finished(LOOK_S):
                    return result
                if pool.used_bytes() > most_bytes:  # where the system sets no limit
                    raise MemoryError
        except MemoryError:
            reason = too_large
        except KilledProcessError:
            reason = "ends its process"
    raise InputError(
        f"{path}: is damaged, or made to do harm: reading it {reason}; copy it again, or name "
        "another file"
    )


def _read(read: Callable, path: Path, arguments: tuple, most_bytes: int, _report: object) -> Any:
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (most_bytes, most_bytes))
    return read(path, *arguments)
