"""The one line with which a function refuses what it is given."""

from collections.abc import Callable

import pytest

from zoo.base.errors import InputError


def refusal(function: Callable, *arguments: object, **keys: object) -> str:
    """Return the message of the InputError that a function raises; check that it is one line."""
    with pytest.raises(InputError) as caught:
        function(*arguments, **keys)
    message = str(caught.value)
    assert "\n" not in message
    return message
