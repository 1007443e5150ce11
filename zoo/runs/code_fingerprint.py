"""Which code a run was trained with, so that a repeat can tell that it is another now."""

import functools
import hashlib
import subprocess
from pathlib import Path

from zoo.cli.compose import conf_folder

PACKAGES = ("zoo", "datamodules", "simulator", "hydra_plugins")


@functools.cache
def code_fingerprint() -> dict[str, str | None]:
    """For `metrics.json`: `hash`, of every `.py` of our packages and every YAML of `conf`, by name
    and content; and `commit`, where they are a git checkout, with `-dirty` where some file differs
    from it.

    Of the first call in this process: what is imported then stays, whatever is edited later.
    """
    root = Path(__file__).resolve().parents[2]
    return {"hash": hash_of_code(root, conf_folder()), "commit": commit_of(root)}


def hash_of_code(root: Path, conf: Path) -> str:
    """Sixteen hexadecimal digits; the same for a checkout and for what is installed from it."""
    files = {
        path.relative_to(root).as_posix(): path
        for package in PACKAGES
        for path in (root / package).rglob("*.py")
        if package != "hydra_plugins" or path.parent.name == "drivezoo"  # others share that name
    }
    files |= {f"conf/{path.relative_to(conf).as_posix()}": path for path in conf.rglob("*.yaml")}
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\n{hashlib.sha256(files[name].read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()[:16]


def commit_of(root: Path) -> str | None:
    """None where `root` is no checkout of its own, or there is no git."""
    if not (root / ".git").exists():  # a folder above may be a checkout of something else
        return None
    command = [
        "git",
        "-C",
        str(root),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=12",
        "--exclude=*",
    ]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return found.stdout.strip() or None
