"""Is what is installed what `pyproject.toml` asks for?"""

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
# They install modules of the same name over each other, and the last one wins.
RIVALS = {
    "opencv-python-headless": ("opencv-python", "opencv-contrib-python"),
    "albumentations": ("albumentationsx",),
}
SHOWN = ("torch", "lightning", "numpy", "opencv-python-headless", "python-socketio")


def check_python() -> Iterator[Finding]:
    """The interpreter that runs this."""
    version, range_ = platform.python_version(), f"{_dotted(OLDEST)} to {_dotted(NEWEST)}"
    if OLDEST <= sys.version_info[:2] <= NEWEST:
        yield Finding(OK, "Python", f"{version}, {sys.executable}")
    else:
        yield Finding(
            FAULT,
            "Python",
            f"{version} at {sys.executable}; supported are {range_}",
            f"python{_dotted(NEWEST)} -m venv .venv && .venv/bin/pip install -e .",
        )


def check_packages() -> Iterator[Finding]:
    """Each dependency against its range, and what is known to be bad or in the way."""
    wanted, source = read_requirements()
    if not wanted:
        yield Finding(WARNING, "packages", "there is no pyproject.toml to compare with", INSTALL)
        return
    missing = [name for name in map(_name, wanted) if installed_version(name) is None]
    if missing:
        found = f"not installed: {', '.join(missing)}"
        yield Finding(FAULT, "packages", found, INSTALL)
    if installed_version("packaging") is None:  # it reads versions, and is none of ours
        return
    good = {}
    for line in wanted:
        findings = list(_look_at(line))
        yield from findings
        name = _name(line)
        if name not in missing and all(finding.state != FAULT for finding in findings):
            good[name] = installed_version(name)
    shown = ", ".join(f"{name} {good[name]}" for name in SHOWN if name in good)
    yield Finding(OK, "packages", f"{len(good)} within the ranges of {source}: {shown}")


def _look_at(line: str) -> Iterator[Finding]:
    """What is wrong with the package of a requirement, which is installed."""
    from packaging.requirements import Requirement

    requirement = Requirement(line)
    name, version = requirement.name, installed_version(requirement.name)
    if version is None:
        return
    install = f"pip install '{name}{requirement.specifier}'"
    if (name, version) in KNOWN_BAD:
        fix = f"pip uninstall {name}; change the passwords that it could read; {install}"
        found = f"{name} {version} {KNOWN_BAD[name, version]}"
        yield Finding(FAULT, "packages", found, fix)
    elif not requirement.specifier.contains(version, prereleases=True):
        found = f"{name} {version} is not within {requirement.specifier}"
        yield Finding(FAULT, "packages", found, install)
    for rival in RIVALS.get(name, ()):
        if installed_version(rival):
            found = f"{rival} is installed too, over the modules of {name}"
            yield Finding(WARNING, "packages", found, f"pip uninstall {rival} {name}; {install}")


def read_requirements() -> tuple[list[str], str]:
    """The dependencies, and where they were read: a checkout's `pyproject.toml`, which is newer
    than what pip noted when it was installed; else that."""
    pyproject = Path(__file__).parents[2] / "pyproject.toml"
    try:
        import tomllib  # since Python 3.11

        project = tomllib.loads(pyproject.read_text(encoding="utf-8"))["project"]
        return project["dependencies"], "pyproject.toml"
    except (ImportError, OSError):
        pass
    try:
        lines = importlib.metadata.requires("drivezoo") or []
        return [line for line in lines if "extra ==" not in line], "drivezoo"
    except importlib.metadata.PackageNotFoundError:
        return [], ""


def installed_version(name: str) -> str | None:
    """The version of a distribution; None where there is none."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _name(requirement: str) -> str:
    return re.match(r"[\w.-]+", requirement)[0]


def _dotted(version: tuple[int, int]) -> str:
    return ".".join(map(str, version))
