"""Work that tests are spared: collections of imported libraries' objects, and waits for a disk."""

import gc
import os

count_frozen = gc.get_freeze_count


def spare_work() -> None:
    """Freeze all objects and keep their number, and let `os.fsync` return at once.

    Python counts them one by one, which takes 0.05 s for half a million, and each command asks. A
    file is synced for a power cut, which no test has; a disk takes 4 to 8 ms each time.
    """
    gc.freeze()
    number = count_frozen()
    gc.get_freeze_count = lambda: number
    os.fsync = lambda descriptor: None
