"""Keywords of a function as the arguments of a command."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from zoo.base.errors import InputError, UsageError
from zoo.cli.conf_files import command_keys


def overrides(keywords: Mapping[str, object]) -> list[str]:
    """Return keywords as overrides of `drivezoo train`; the keys of a dict are joined by dots.

    >>> overrides({"model": "lenet", "data": {"root": "lake", "val_share": 0.2}, "quick": True})
    ['model=lenet', 'data.root=lake', 'data.val_share=0.2', 'quick=true']
    """
    return [f"{key}={typed(value)}" for key, value in _flat(keywords)]


def options(command: str, keywords: Mapping[str, object]) -> list[str]:
    """Return keywords as options of a command, such as `weather={"fog": 0.4}`.

    >>> options("evaluate", {"track": ["lake", "mountain"], "film": True, "margin": None})
    ['track=lake,mountain', 'film=true', 'margin=null']
    >>> options("drive", {"speed": {"set_mph": 12}})
    ['speed.set_mph=12']
    """
    parents = {one.name.partition(".")[0] for one in command_keys(command) if "." in one.name}
    found = []
    for key, value in keywords.items():
        pairs = _flat({key: value}) if key in parents else [(key, value)]
        for name, one in pairs:
            texts = [typed(each) for each in one] if isinstance(one, list | tuple) else [typed(one)]
            found.append(f"{name}={','.join(texts)}")
    return found


def typed(value: object) -> str:
    """Return a value as users type it; a text stays as it is.

    >>> typed([1, None, "a"]), typed({"fog": 0.4})
    ('[1,null,a]', '{fog: 0.4}')
    """
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{','.join(map(typed, value))}]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {typed(one)}" for key, one in value.items()) + "}"
    return str(getattr(value, "checkpoint", value))  # of what `train` returned


def _flat(keywords: Mapping[str, object], prefix: str = "") -> Iterable[tuple[str, object]]:
    for key, value in keywords.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def checkpoint_of(driver: Any) -> Any:
    """Return the path of a checkpoint as text; a policy unchanged.

    Raises:
        UsageError: the driver is neither.
        InputError: the training kept no checkpoint.
    """
    found = getattr(driver, "checkpoint", driver)
    if found is None and driver is not None:
        raise InputError(f"{driver.folder}: the run kept no checkpoint; train again with one")
    if not isinstance(found, str | Path) and not callable(found):
        raise UsageError(
            f"{found}: is no driver; name a checkpoint's path, a run, or a function of a frame and "
            "mph"
        )
    return str(found) if isinstance(found, Path) else found


def folder_of(result: Any) -> str:
    """Return the folder of a result as text; a path as text."""
    return str(getattr(result, "folder", result))
