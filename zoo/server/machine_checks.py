"""Checks of the machine: Python, packages, device, disk and port."""

from __future__ import annotations

import ast
import errno
import importlib.metadata
import os
import platform
import re
import shutil
import socket
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.machine import usable_cores
from zoo.base.output_files import OUTPUTS
from zoo.base.terminal import counted

OK, WARNING, FAULT = "ok", "warning", "fault"
INSTALL = "activate the virtual environment, then in the checkout: pip install -e ."
OLDEST, NEWEST = (3, 10), (3, 13)
MALWARE = {("lightning", "2.6.2"), ("lightning", "2.6.3")}  # GHSA-w37p-236h-pfx3
# Packages that overwrite each other's modules; the last one installed stays.
RIVALS = {
    "opencv-python-headless": ("opencv-python", "opencv-contrib-python"),
    "albumentations": ("albumentationsx",),
}
SHOWN = ("torch", "lightning", "numpy", "opencv-python-headless", "python-socketio")
FULL_GB, LOW_GB = 0.2, 2.0  # a training run on the lake writes about 0.2 GB, with its cache
CACHE = OUTPUTS / "cache"  # as conf/data: data.cache


@dataclass(frozen=True)
class Finding:
    """A row of the doctor's table.

    Attributes:
        state: `ok`, `warning` (works, with a drawback) or `fault` (something does not work).
        what: subject of the check, in a word or two.
        found: result of the check, in one line.
        fix: action for the user; empty where none is needed.
    """

    state: str
    what: str
    found: str
    fix: str = ""


def careful(
    what: str, check: Callable[[], Iterator[Finding]], usual_fix: str = INSTALL
) -> Iterator[Finding]:
    """Yield the findings of a check; an exception becomes a finding, not a traceback.

    One of our errors is `what was found; what to do`; without the second part it gets the usual
    fix.
    """
    try:
        yield from check()
    except InputError as error:
        text = " ".join(str(error).split())
        result, _, fix = text.rpartition("; ")
        yield Finding(FAULT, what, result or text, fix if result else usual_fix)
    except ModuleNotFoundError as error:
        yield Finding(FAULT, what, f"not checked: {error.name} is not installed", INSTALL)
    except Exception as error:  # a damaged library can raise anything
        reason = " ".join(str(error).split()) or "no reason given"
        yield Finding(FAULT, what, f"the check failed: {type(error).__name__}: {reason}", INSTALL)


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
            "install such a Python, and a new environment as docs/quickstart.md says",
        )


def check_packages() -> Iterator[Finding]:
    """Check each dependency's version, and packages that are known to do harm."""
    wanted, source = read_requirements()
    if not wanted:
        yield Finding(WARNING, "packages", "found no pyproject.toml to compare with", INSTALL)
        return
    missing = [name for name in map(_name, wanted) if installed_version(name) is None]
    if missing:
        yield Finding(FAULT, "packages", f"not installed: {', '.join(missing)}", INSTALL)
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
    install = f'pip install "{name}{requirement.specifier}"'
    if (name, version) in MALWARE:
        fix = f"pip uninstall {name}; change all passwords stored on this machine; {install}"
        yield Finding(FAULT, "packages", f"{name} {version} carries malware", fix)
    elif not requirement.specifier.contains(version, prereleases=True):
        result = f"{name} {version} is installed, {requirement.specifier} is required"
        yield Finding(FAULT, "packages", result, install)
    for rival in RIVALS.get(name, ()):
        if installed_version(rival):
            result = f"{rival} is also installed; it overwrites modules of {name}"
            yield Finding(WARNING, "packages", result, f"pip uninstall {rival} {name}; {install}")


def read_requirements() -> tuple[list[str], str]:
    """Return the dependencies, and the name of their source.

    A checkout's `pyproject.toml` comes first: pip's record of an editable install can be older.
    """
    try:
        text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
        # Without a reader of TOML, which Python 3.10 lacks: this list is one of Python's, too.
        if found := re.search(r"^dependencies = (\[.*?^\])", text, re.MULTILINE | re.DOTALL):
            return ast.literal_eval(found[1]), "pyproject.toml"
    except OSError:
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
    return re.split(r"[^\w.-]", requirement, maxsplit=1)[0]


def _dotted(version: tuple[int, int]) -> str:
    return ".".join(map(str, version))


def check_device() -> Iterator[Finding]:
    """Check the devices that can compute networks."""
    import torch

    threads, cores = torch.get_num_threads(), usable_cores()
    setting = f"OMP_NUM_THREADS is {os.environ.get('OMP_NUM_THREADS') or 'not set'}"
    result = f"{counted(threads, 'thread')} on {counted(cores, 'core')}, {setting}"
    if threads > cores:
        fix = f"set the variable OMP_NUM_THREADS to {cores}: more threads slow each other down"
        yield Finding(WARNING, "CPU", result, fix)
    else:
        yield Finding(OK, "CPU", result)
    with warnings.catch_warnings(record=True) as caught:  # torch warns about an old graphics driver
        warnings.simplefilter("always")
        available = torch.cuda.is_available()
    if available:
        yield from _check_cuda()
    elif shutil.which("nvidia-smi"):
        reason = f"torch {torch.__version__} cannot use it"
        if caught:
            reason += f": {str(caught[0].message).splitlines()[0]}"
        fix = "install the torch for its driver, see https://pytorch.org/get-started/locally"
        yield Finding(WARNING, "GPU", f"found an NVIDIA GPU, but {reason}", fix)
    else:
        yield Finding(OK, "GPU", "none found; training uses the CPU")


def _check_cuda() -> Iterator[Finding]:
    import torch

    name = torch.cuda.get_device_name(0)
    try:
        free, total = (size / 1e9 for size in torch.cuda.mem_get_info(0))
        torch.nn.functional.conv2d(
            torch.ones(1, 1, 8, 8, device="cuda"), torch.ones(1, 1, 3, 3, device="cuda")
        ).sum().item()
    except RuntimeError as error:
        fix = "end other programs that use it, or train with trainer=cpu"
        yield Finding(FAULT, "GPU", f"{name} cannot compute: {str(error).splitlines()[0]}", fix)
        return
    yield Finding(OK, "GPU", f"{name}, {free:.1f} of {total:.1f} GB free")


def check_disk() -> Iterator[Finding]:
    """Check free space and write permission in the folder of runs."""
    folder = OUTPUTS.absolute() if OUTPUTS.is_dir() else Path.cwd()
    free_gb = shutil.disk_usage(folder).free / 1e9
    result = f"{free_gb:.1f} GB free in {folder}"
    fix = "delete files, or write to another disk: hydra.run.dir=FOLDER data.cache=null"
    if not os.access(folder, os.W_OK):
        yield Finding(FAULT, "disk", f"{folder} cannot be written", "change to another folder")
    elif free_gb < LOW_GB:
        yield Finding(FAULT if free_gb < FULL_GB else WARNING, "disk", result, fix)
    else:
        yield Finding(OK, "disk", result)


def check_cache() -> Iterator[Finding]:
    """Print the size of the decoded images that trainings keep."""
    size = 0
    for path in CACHE.rglob("*"):
        with suppress(OSError):  # a training removes files meanwhile
            size += path.stat().st_size
    if size:
        result = f"{size / 1e9:.1f} GB in {CACHE.absolute()}; delete the folder to empty it"
        yield Finding(OK, "cache", result)


def check_port(port: int) -> Iterator[Finding]:
    """Check that the driver can listen on a port."""
    from zoo.base.machine import port_holder

    what = f"port {port}"
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        if os.name == "posix":  # ignore connections that have just ended
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
            # With that option, a second socket binds too, and fails only when it listens.
            probe.listen(1)
        except OSError as error:
            if error.errno == errno.EACCES:
                yield Finding(FAULT, what, "not allowed to this user", "drive with port=4567")
            elif error.errno == errno.EADDRINUSE:
                holder = port_holder(port) or "another user's process"
                fix = "end that process, or drive with port=4568"
                is_driver = re.search(r"zoo\S*[. ]drive\b", holder)  # of this user
                yield Finding(WARNING if is_driver else FAULT, what, f"used by {holder}", fix)
            else:
                raise
            return
    yield Finding(OK, what, "free")
