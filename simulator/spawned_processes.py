"""What processes that are spawned, not forked, must not do again."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


@contextmanager
def hidden_script() -> Iterator[None]:
    """Start processes that do not run the user's script again.

    Spawned processes import the `__main__` module: a script without `if __name__ == "__main__":`
    would drive again in each of them. The jobs need nothing from it.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
