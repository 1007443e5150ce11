"""The objects of imported libraries, which garbage collections of tests skip."""

import gc

count_frozen = gc.get_freeze_count


def freeze_objects() -> None:
    """Freeze all objects, and keep their number.

    Python counts them one by one, which takes 0.05 s for half a million, and each command asks.
    """
    gc.freeze()
    number = count_frozen()
    gc.get_freeze_count = lambda: number
