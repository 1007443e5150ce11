"""Members of a table of tests that `make test-all` alone runs.

A member is a test's argument, or a tuple of its arguments.
"""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def slow(*members: Any) -> list:
    """Return the members, all marked slow."""
    return slow_but((), members)


def slow_but(plain: Collection, members: Iterable) -> list:
    """Return the members in their order, all marked slow but those in `plain`."""
    return [
        pytest.param(
            *(member if isinstance(member, tuple) else (member,)),
            marks=() if member in plain else pytest.mark.slow,
        )
        for member in members
    ]
