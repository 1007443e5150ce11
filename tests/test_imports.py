"""The allowed imports between packages: zoo -> datamodules, zoo -> simulator; all -> zoo.base."""

import ast
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
BASE = "zoo.base."
FORBIDDEN = {
    "datamodules": {"drivezoo", "zoo", "simulator"},
    "simulator": {"drivezoo", "zoo", "datamodules"},
    "zoo": {"drivezoo"},
}
FILES = [
    path
    for package in FORBIDDEN
    for path in sorted((REPOSITORY / package).rglob("*.py"))
    if (REPOSITORY / package).is_dir()
]


def imported_packages(source: str) -> set[str]:
    """Return the packages of all imports, also in functions and in `import_module("...")`."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "import_module":
            found |= {one.value for one in node.args if isinstance(one, ast.Constant)}
    outside = {name for name in found if not f"{name}.".startswith(BASE)}
    return {name.split(".")[0] for name in outside}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_imports_run_one_way(path):
    package = path.relative_to(REPOSITORY).parts[0]
    assert not imported_packages(path.read_text()) & FORBIDDEN[package]


def test_imports_are_found_everywhere_in_a_file():
    source = """
import os.path, zoo.runs.plots as plots
def late():
    from simulator.track import Track
    importlib.import_module("datamodules.view")
    from zoo.base.errors import InputError
from . import near
"""
    assert imported_packages(source) == {"os", "zoo", "simulator", "datamodules"}


def test_there_are_files_to_check():
    assert REPOSITORY / "datamodules" / "view.py" in FILES
