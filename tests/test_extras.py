"""Each folder of `zoo/extras` can be deleted with its tests: the core does not notice."""

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import EntryPoint, distribution
from pathlib import Path

import pytest

from zoo.base.console_script import ALIASES, ENTRY_POINTS, extra_commands
from zoo.base.entry_points import is_extra

ROOT = Path(__file__).parents[1]
EXTRAS = sorted(path.name for path in (ROOT / "zoo" / "extras").iterdir() if path.is_dir())
EXTRAS = [name for name in EXTRAS if not name.startswith("_")]
# Prints the exit status and the last line of each command typed; all in one process, since each new
# one imports for a second.
DRIVEZOO = """
import contextlib, io, json, sys
from zoo.base.console_script import main
ends = []
for typed in json.loads(sys.argv[1]):
    sys.argv = ["drivezoo", *typed]
    with contextlib.redirect_stderr(io.StringIO()) as errors:
        try:
            status = main()
        except SystemExit as end:
            status = end.code
    ends.append((status, (errors.getvalue().splitlines() or [""])[-1]))
print("\\n" + json.dumps(ends))
"""
# What a user types to choose an entry point of a group.
CHOICES = {
    "drivezoo.dialects": ("simulator", "client", "dialect={}"),
    "drivezoo.simulators": ("drive", "tiny41", "world={}"),
    "drivezoo.worlds": ("evaluate", "tiny41", "world={}"),
}
LEFT_OUT = shutil.ignore_patterns(
    ".git", ".venv", ".*_cache", ".hypothesis", "outputs", "_build", "dist"
)


def without(names: list[str], folder: Path) -> Path:
    """Return a copy of the checkout without extras and their tests."""
    shutil.copytree(ROOT, folder, ignore=LEFT_OUT)
    for name in names:
        shutil.rmtree(folder / "zoo" / "extras" / name)
        shutil.rmtree(folder / "tests" / "zoo" / "extras" / name, ignore_errors=True)
    return folder


def joined(name: str) -> list[EntryPoint]:
    """Return the entry points of an extra."""
    entries = filter(is_extra, distribution("drivezoo").entry_points)
    return [entry for entry in entries if entry.value.startswith(f"zoo.extras.{name}.")]


def run(folder: Path, *words: str) -> subprocess.CompletedProcess:
    given = os.environ | {"PYTHONPATH": str(folder)}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=given, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("name", EXTRAS)
def test_without_an_extra_the_other_commands_are_there(name: str, tmp_path: Path) -> None:
    copy = without([name], tmp_path / "copy")
    entries = joined(name)
    assert entries, "an extra that nothing joins"
    gone = {entry.name for entry in entries if entry.group == ENTRY_POINTS}
    chosen = [
        [word.format(entry.name) for word in CHOICES[entry.group]]
        for entry in entries
        if entry.group in CHOICES
    ]
    typed = [["--help"], *(command.split(".") for command in sorted(gone)), *chosen]
    printed = run(copy, "-c", DRIVEZOO, json.dumps(typed))
    assert printed.returncode == 0, printed.stderr
    *help_lines, ends = printed.stdout.splitlines()
    (help_status, _), *refusals = json.loads(ends)
    assert not help_status
    shown = {line.split()[0] for line in help_lines if line.startswith("  ")}
    assert gone.isdisjoint(shown)
    assert shown >= {"train", "evaluate", *extra_commands()} - gone - {*ALIASES}
    assert {status for status, _ in refusals} <= {2}
    for _, line in refusals[: len(gone)]:
        assert "no such command" in line
    for words, (_, line) in zip(chosen, refusals[len(gone) :], strict=True):
        assert f"{words[-1]}: " in line


def passes(copy: Path, *tests: str) -> None:
    """Assert that the quick tests of a copy pass."""
    as_make_test = ("-m", "pytest", "-n", "2", "--dist", "loadfile", "-m", "not slow")
    result = run(copy, *as_make_test, *tests)
    assert result.returncode == 0, result.stdout[-3000:]


@pytest.mark.slow
def test_without_any_extra_the_core_passes(tmp_path: Path) -> None:
    of_all = ("test_extras.py", "test_manual.py", "test_model_pages.py", "test_count.py")
    passes(without(EXTRAS, tmp_path / "copy"), "tests", *[f"--ignore=tests/{f}" for f in of_all])


@pytest.mark.slow
@pytest.mark.parametrize("name", EXTRAS)
def test_an_extra_passes_without_the_others(name: str, tmp_path: Path) -> None:
    copy = without([other for other in EXTRAS if other != name], tmp_path / "copy")
    passes(copy, f"tests/zoo/extras/{name}")
