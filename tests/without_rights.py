"""A user without rights, in this process."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_rights() -> Iterator[None]:
    """Become another user where this one is root, who may read and write everything."""
    is_root = os.geteuid() == 0
    if is_root:
        os.seteuid(65_534)  # nobody
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)
