"""Configs that many tests read, each composed once in a process."""

import copy
import functools

from zoo.base.compose import compose_config


def composed(*overrides: str) -> dict:
    """Return a new copy of the config of `drivezoo train OVERRIDES`.

    A composition takes 0.2 s. For overrides without paths, since the current folder may change.
    """
    return copy.deepcopy(_composed(overrides))


@functools.cache
def _composed(overrides: tuple[str, ...]) -> dict:
    return compose_config(list(overrides))
