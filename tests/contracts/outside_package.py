"""A package that is installed outside the checkout: a folder with its code and its entry points."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.zoo.command_runs import ROOT
from zoo.base.parts import _installed
from zoo.base.registry import Registry


def manual_example(file: str) -> str:
    """Return the code of a file in docs/extending.md."""
    page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    return page.partition(f"# {file}\n")[2].partition("```")[0]


def write_manual_examples(folder: Path, *files: str) -> None:
    """Write files of docs/extending.md below a folder."""
    for file in files:
        (folder / file).parent.mkdir(exist_ok=True, parents=True)
        (folder / file).write_text(manual_example(file))


def write_package(folder: Path, name: str, code: str, entry_points: str) -> None:
    """Write an installed package of one module, and what its `entry_points.txt` says."""
    about = folder / f"{name}-1.dist-info"
    about.mkdir(parents=True)
    (folder / f"{name}.py").write_text(code)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (about / "entry_points.txt").write_text(entry_points)


@contextmanager
def installed(
    folder: Path,
    code: str,
    group: str,
    *registries: Registry,
    name: str = "outside_part",
    attribute: str = "",
) -> Iterator[None]:
    """Install a module, or its `:attribute`, as the entry point `mine`; remove it at the end."""
    write_package(folder, name, code, f"[{group}]\nmine = {name}{attribute}\n")
    with pytest.MonkeyPatch.context() as patch:
        for registry in registries:
            len(registry)  # what is imported below would be registered in the copy alone
            patch.setattr(registry, "_entries", dict(registry._entries))
        patch.syspath_prepend(folder)
        _installed.cache_clear()
        try:
            yield
        finally:
            sys.modules.pop(name, None)
    _installed.cache_clear()
