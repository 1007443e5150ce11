"""A package that is installed outside the checkout: a folder with its code and its entry points."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from zoo.base.parts import _installed
from zoo.base.registry import Registry


@contextmanager
def installed(
    folder: Path,
    code: str,
    group: str,
    *registries: Registry,
    name: str = "outside_part",
    member: str = "",
) -> Iterator[None]:
    """Install a module, or a member of it, as an entry point; remove what it registers at the end.

    Args:
        folder: folder to write the package to.
        code: text of the module.
        group: group of the entry point, whose name is `mine`.
        *registries: registries that the module adds to.
        name: name of the module.
        member: member of the module that the entry point names; empty for the module.
    """
    about = folder / f"{name}-1.dist-info"
    about.mkdir(parents=True)
    place = f"{name}:{member}" if member else name
    (folder / f"{name}.py").write_text(code)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (about / "entry_points.txt").write_text(f"[{group}]\nmine = {place}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        for registry in registries:
            patch.setattr(registry, "_entries", dict(registry._entries))
            patch.setattr(registry, "_imported", set())
        _installed.cache_clear()
        try:
            yield
        finally:
            sys.modules.pop(name, None)
    _installed.cache_clear()
