"""Checks of Python and the installed packages against `pyproject.toml`."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from zoo.doctor.finding import FAULT, INSTALL, OK, WARNING, Finding

OLDEST, NEWEST = (3, 10), (3, 13)
KNOWN_BAD = {
    ("lightning", "2.6.2"): "carries malware (GHSA-w37p-236h-pfx3)",
    ("lightning", "2.6.3"): "carries malware (GHSA-w37p-236h-pfx3)",
}
# Packages that overwrite each other's modules; the last one installed stays.
RIVALS = {
    "opencv-python-headless": ("opencv-python", "opencv-contrib-python"),
    "albumentations": ("albumentationsx",),
}
SHOWN = ("torch", "lightning", "numpy", "opencv-python-headless", "python-socketio")


def check_python() -> Iterator[Finding]:
    """Check the version of the running interpreter."""
    version, range_ = platform.python_version(), f"{_dotted(OLDEST)} to {_dotted(NEWEST)}"
    if OLDEST <= sys.version_info[:2] <= NEWEST:
        yield Finding(OK, "Python", f"{version}, {sys.executable}")
    else:
        yield Finding(
            FAULT,
            "Python",
            f"{version} at {sys.executable}; drivezoo supports {range_}",
            f"python{_dotted(NEWEST)} -m venv .venv && .venv/bin/pip install -e .",
        )


def check_packages() -> Iterator[Finding]:
    """Check each dependency's version, and packages that are known to do harm."""
    wanted, source = read_requirements()
    if not wanted:
        yield Finding(WARNING, "packages", "found no pyproject.toml to compare with", INSTALL)
        return
    missing = [name for name in map(_name, wanted) if installed_version(name) is None]
    if missing:
        found = f"not installed: {', '.join(missing)}"
        yield Finding(FAULT, "packages", found, INSTALL)
    for line in wanted:
        yield from _check_package(line)
    versions = {name: installed_version(name) for name in SHOWN}
    shown = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    yield Finding(OK, "packages", f"compared with the versions that {source} requires: {shown}")


def _check_package(line: str) -> Iterator[Finding]:
    """Yield the problems of a requirement's package, if it is installed."""
    from packaging.requirements import Requirement

    requirement = Requirement(line)
    name, version = requirement.name, installed_version(requirement.name)
    if version is None:
        return
    install = f"pip install '{name}{requirement.specifier}'"
    if (name, version) in KNOWN_BAD:
        fix = f"pip uninstall {name}; change all passwords stored on this machine; {install}"
        found = f"{name} {version} {KNOWN_BAD[name, version]}"
        yield Finding(FAULT, "packages", found, fix)
    elif not requirement.specifier.contains(version, prereleases=True):
        found = f"{name} {version} is installed, {requirement.specifier} is required"
        yield Finding(FAULT, "packages", found, install)
    for rival in RIVALS.get(name, ()):
        if installed_version(rival):
            found = f"{rival} is also installed; it overwrites modules of {name}"
            yield Finding(WARNING, "packages", found, f"pip uninstall {rival} {name}; {install}")


def read_requirements() -> tuple[list[str], str]:
    """Return the dependencies, and the name of their source.

    A checkout's `pyproject.toml` comes first: pip's record of an editable install can be older.
    """
    try:
        import tomllib  # since Python 3.11

        text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
        return tomllib.loads(text)["project"]["dependencies"], "pyproject.toml"
    except (ImportError, OSError):
        pass
    try:
        lines = importlib.metadata.requires("drivezoo") or []
        return [line for line in lines if "extra ==" not in line], "drivezoo"
    except importlib.metadata.PackageNotFoundError:
        return [], ""


def installed_version(name: str) -> str | None:
    """Return the version of a package; None if it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _name(requirement: str) -> str:
    return re.match(r"[\w.-]+", requirement)[0]


def _dotted(version: tuple[int, int]) -> str:
    return ".".join(map(str, version))
