"""Identify the code that trained a run, so that a repeat can report changed code."""

import functools
import hashlib
import platform
import subprocess
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

from zoo.base.child_process import find_program
from zoo.base.compose import conf_folder

PACKAGES = ("zoo", "datamodules", "hydra_plugins")
# Packages that change results.
VERSIONS = ("drivezoo", "torch", "lightning", "albumentations", "opencv-python-headless", "numpy")


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the packages in `VERSIONS`."""
    return {"python": platform.python_version()} | {name: version(name) for name in VERSIONS}


# What a result says of its code: `hash`, `commit` and `changed`.
CodeFacts: TypeAlias = dict[str, str | list[str] | None]
MOST_CHANGED = 100  # named files


@functools.cache
def code_fingerprint() -> CodeFacts:
    """Return the code's `hash` and git `commit`, and the `changed` files, for `metrics.json`.

    The hash is of the names and contents of drivezoo's `.py` files and of `conf`'s YAML files. The
    commit is None outside a git checkout, and ends in `-dirty` if files differ from it, which are
    named. The first call's result is kept: later edits do not change the code that this process has
    imported.
    """
    root = Path(__file__).resolve().parents[2]
    facts: CodeFacts = {"hash": hash_of_code(root, conf_folder()), "commit": commit_of(root)}
    changed = changed_files(root)
    return facts | ({"changed": changed[:MOST_CHANGED]} if changed else {})


def hash_of_code(root: Path, conf: Path) -> str:
    """Return 16 hexadecimal digits, the same in checkouts of all systems and in packages."""
    files = {
        path.relative_to(root).as_posix(): path
        for package in PACKAGES
        for path in (root / package).rglob("*.py")
        if package != "hydra_plugins"
        or path.parent.name == "drivezoo"  # other packages share the name hydra_plugins
    }
    files |= {f"conf/{path.relative_to(conf).as_posix()}": path for path in conf.rglob("*.yaml")}
    digest = hashlib.sha256()
    for name in sorted(files):
        text = files[name].read_bytes().replace(b"\r\n", b"\n")  # git writes CRLF on Windows
        digest.update(f"{name}\n{hashlib.sha256(text).hexdigest()}\n".encode())
    return digest.hexdigest()[:16]


def commit_of(root: Path) -> str | None:
    """Return the commit of the checkout `root`; None if it is not one, or without git."""
    options = ("--always", "--dirty", "--abbrev=12", "--exclude=*")
    return _git(root, "describe", *options).strip() or None


def changed_files(root: Path) -> list[str]:
    """Return the tracked files of the checkout `root` that differ from its commit."""
    return _git(root, "diff", "HEAD", "--name-only", "-z").split("\0")[:-1]


def _git(root: Path, *words: str) -> str:
    """Return the output of a command of git; empty outside a checkout, or without git."""
    git = find_program("git")
    with suppress(OSError, subprocess.TimeoutExpired):
        if git and (root / ".git").exists():  # a parent folder may be another project's checkout
            done = subprocess.run([git, "-C", str(root), *words], capture_output=True, timeout=10)
            return done.stdout.decode(errors="replace")
    return ""
